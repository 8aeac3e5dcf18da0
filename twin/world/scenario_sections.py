"""The sections of a scenario file: board, light, camera, pose tracker, shaft, push and occluder."""

from __future__ import annotations

from math import cos, pi, radians, sin
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from endolock.hw import rotation
from endolock.hw.files import Section
from endolock.twin.world.motion import Event, along

_Side = Annotated[float, Field(gt=0, le=10)]
_Place = Annotated[float, Field(ge=-10, le=10)]


class Board(Section):
    """Kind and initial pose of the board."""

    distance_m: float = Field(default=0.12, gt=0.005, lt=1.5)
    """Depth ahead of the tip camera at rest [m]. Source: 12 cm, thesis ch. 6."""
    depth_travel_m: float = Field(default=0.0, ge=0, lt=1)
    """Travel of a sinusoidal motion along the optical axis, peak to peak [m]."""
    depth_period_s: float = Field(default=8.6, ge=0.01, le=1e9)
    """Period of that motion [s]. Assumed."""
    kind: Literal["rings", "tissue", "several"] = "rings"
    """Print in the middle; every board has markers around it."""
    target: int = Field(default=0, ge=0, le=3)
    """Number of the patch that is the target; only `several` has others than 0."""
    tilt_deg: float = Field(default=0.0, ge=-85, le=85)
    """Rotation of the board about an axis in its plane through its centre [deg]."""
    tilt_axis_deg: float = 0.0
    """Direction of that axis in the picture: 0 right, 90 up [deg]."""

    @property
    def quaternion(self) -> rotation.Quaternion:
        """Orientation of the board, base_from_board, scalar first."""
        axis = radians(self.tilt_axis_deg)
        return rotation.about((cos(axis), -sin(axis), 0.0), radians(self.tilt_deg))

    @model_validator(mode="after")
    def _target_is_there(self) -> Self:
        count = 4 if self.kind == "several" else 1
        if self.target >= count:
            raise ValueError(f"target {self.target}: board {self.kind} has {count}, from 0")
        return self


class Light(Section):
    """Illumination; the parts add up."""

    room: float = Field(default=1.0, ge=0, le=4)
    """Ambient light, and some from above [1]. Assumed."""
    tip: float = Field(default=1.0, ge=0, le=4)
    """Light guide next to the camera [1]. Assumed."""
    falls_off: bool = False
    """Whether the tip's light falls with the square of the distance, and off its axis; at 50 mm it
    is as bright as without."""
    back: float = Field(default=0.0, ge=0, le=1)
    """Light emitted by the board itself, as if lit from behind or a screen [1]. Assumed."""


class CameraSettings(Section):
    """Tip camera and video chain; by default ideal except for geometry, frame rate and latency."""

    width: int = Field(default=640, ge=16, le=4096)
    """Width of the picture [px]."""
    height: int = Field(default=480, ge=16, le=4096)
    """Height of the picture [px]."""
    projection: Literal["pinhole", "equidistant"] = "pinhole"
    """equidistant is a fisheye, remapped from a wider picture; it takes 3 times as long."""
    fovy_deg: float = Field(default=85.0, gt=1, lt=170)
    """Full vertical field of view of a pinhole [deg]. Assumed; f = 262 px at 480 rows."""
    diagonal_deg: float = Field(default=120.0, ge=40, le=150)
    """Full field of view of a fisheye across the corners [deg]. Assumed: 120 and 140 are common."""
    mask: Literal["none", "octagon", "circle"] = "none"
    """Visible part of the picture."""
    vignette: float = Field(default=0.0, ge=0, le=1)
    """Loss of light in the corners [1], growing with the fourth power of the radius. Assumed."""
    gain: float = Field(default=1.0, gt=0, le=16)
    """Factor on the brightness; values above white are clipped [1]. Assumed."""
    exposure_s: float = Field(default=0.0, ge=0, le=0.1)
    """Exposure time, centred on the time of the frame [s]; 0 gives no motion blur. Assumed."""
    sub_exposures: int = Field(default=5, ge=1, le=31)
    """Number of pictures averaged over an exposure, odd; one is drawn if nothing moves by a pixel.
    Assumed: at 7 px of blur they are 1.4 px apart."""
    noise: float = Field(default=0.0, ge=0, le=64)
    """Standard deviation of the sensor's noise [grey levels of 255]. Assumed."""
    jpeg_quality: int = Field(default=0, ge=0, le=100)
    """Quality at which every frame is JPEG-coded and decoded; 0 for no coding. Assumed."""
    frame_rate_hz: float = Field(default=25.0, gt=0, le=200)
    """Exposures per second [Hz]. Assumed."""
    latency_s: float = Field(default=0.4, ge=0, le=5)
    """Exposure to delivery [s]. Source: 0.4 s loop latency, thesis ch. 7; all of it in the video
    chain: assumed."""
    nominal_latency_s: float | None = Field(default=None, ge=0, le=5)
    """Latency from which the camera computes the time of exposure [s]; the true one if None."""
    jitter_s: float = Field(default=0.0, ge=0, le=1)
    """Half width of the uniform variation of the latency [s]. Assumed."""
    drop_fraction: float = Field(default=0.0, ge=0, lt=1)
    """Share of the frames that never arrive [1]. Assumed."""
    repeat_fraction: float = Field(default=0.0, ge=0, lt=1)
    """Share of the frames that are replaced by a copy of the previous one [1]. Assumed."""

    truth_noise_px: float = Field(default=0.0, ge=0, le=100)
    """Standard deviation of the noise that `--vision truth` adds to each coordinate [px]; pictures
    have their own noise."""

    @model_validator(mode="after")
    def _exposure_fits(self) -> Self:
        if self.sub_exposures % 2 == 0:
            raise ValueError(f"sub_exposures {self.sub_exposures} is even; use an odd number")
        if self.exposure_s * self.frame_rate_hz > 1:
            raise ValueError(
                f"exposure_s {self.exposure_s:g} is longer than a frame of "
                f"{1 / self.frame_rate_hz:g} s; use less"
            )
        return self


class PoseTrackerSettings(Section):
    """An optical tracker of the tip's pose, such as the OptiTrack system used in the thesis.

    The model used there is not known, so all values are assumed: those of a small system.
    """

    rate_hz: float = Field(default=100.0, gt=0, le=1000)
    """Poses per second [Hz]. Assumed."""
    latency_s: float = Field(default=0.010, ge=0, le=5)
    """Exposure to delivery [s]. Assumed: one period."""
    position_noise_m: float = Field(default=0.0002, ge=0, le=0.1)
    """Standard deviation along each axis [m]. Assumed."""
    rotation_noise_deg: float = Field(default=0.05, ge=0, le=30)
    """Standard deviation about each axis [deg]. Assumed."""
    drop_fraction: float = Field(default=0.0, ge=0, lt=1)
    """Share of the poses that never arrive [1]. Assumed."""


class Shaft(Event):
    """A permanent change of the shaft, at constant rate."""

    kind: Literal["bend", "roll"]
    """bend adds to `shaft_bend_deg`; roll turns the section about the optical axis at rest,
    clockwise as seen by the camera, so that the scene appears to turn counter-clockwise."""
    by_deg: float = Field(ge=-1080, le=1080)
    """Change [deg]."""


class Push(Event):
    """A force on the tip across the shaft, half a sine: F = force sin(pi (t - start) / over)."""

    force_n: float = Field(ge=0, le=10)
    """Largest force [N]."""
    direction_deg: float = 0.0
    """In the picture at rest: 0 right, 90 up [deg]."""

    def force(self, t: float) -> tuple[float, float]:
        """Force (right, down) at time `t` [N]."""
        part = self.done(t)
        return along(self.force_n * sin(pi * part), self.direction_deg) if part < 1 else (0.0, 0.0)


class Occluder(Event):
    """An opaque plate in the view, moving at constant velocity from one position to another."""

    size_m: tuple[_Side, _Side]
    """Width and height [m]."""
    look: Literal["plain", "tissue", "decoy"] = "plain"
    """Its texture: none, tissue like the wall, or a target that resembles the round one."""
    distance_m: float = Field(gt=0.002, lt=1.5)
    """Depth ahead of the tip camera at rest [m], less than the board's."""
    position_m: tuple[_Place, _Place]
    """Position of the centre (right, down) relative to the optical axis at rest, until the start
    [m]."""
    to_m: tuple[_Place, _Place]
    """Final position of the centre (right, down) [m]."""

    def position(self, t: float) -> tuple[float, float, float]:
        """Position of its centre (right, down, distal) at time `t` [m]."""
        part = self.done(t)
        (x, y), (to_x, to_y) = self.position_m, self.to_m
        return x + part * (to_x - x), y + part * (to_y - y), self.distance_m
