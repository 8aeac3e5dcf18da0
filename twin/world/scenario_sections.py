"""The sections of a scenario file: board, light, camera, pose tracker, shaft, push and occluder."""

from __future__ import annotations

from math import cos, pi, radians, sin, tan
from typing import Annotated, Literal, Self

from pydantic import model_validator

from endolock.hw import boards, rotation
from endolock.hw.api import ConfigError
from endolock.hw.strict import Strict, bounded
from endolock.twin.world.motion import Angle, Event, along

_METRES = "give metres"
_Side = Annotated[float, bounded(0.001, 1, "m", hint=_METRES)]
_Place = Annotated[float, bounded(-2, 2, "m", hint=_METRES)]
_Distance = Annotated[float, bounded(0.005, 1.5, "m", hint=_METRES)]
_Factor = Annotated[float, bounded(0, 4)]
_Share = Annotated[float, bounded(0, 1)]
Lost = Annotated[float, bounded(0, 0.999)]
LARGEST_BEND_DEG = 1080
"""Largest bend of the shaft [deg]: three loops. Assumed."""
ShaftBend = Annotated[float, bounded(-LARGEST_BEND_DEG, LARGEST_BEND_DEG, "deg")]
Latency = Annotated[float, bounded(0, 5, "s", hint="give seconds")]
Jitter = Annotated[float, bounded(0, 1, "s", hint="give seconds")]

LARGEST_PICTURE_PX = 3840 * 2160
"""Most pixels of a delivered picture [1]: 4K, the largest of endoscopes."""
LARGEST_SHOT_PX = 8192
"""Longest side of a rendered picture [px]: the buffers of OpenGL are 16384 px or less."""
FISHEYE_MARGIN = 0.9
"""Focal length of the picture rendered for a fisheye, over that of the fisheye [1]: nearly as fine
in the middle, and finer everywhere else. Source: measured, it does not limit the markers."""


class Board(Strict):
    """Kind and initial pose of the board."""

    distance_m: _Distance = 0.12
    """Depth ahead of the tip camera at rest [m]. Source: 12 cm, thesis ch. 6."""
    depth_travel_m: Annotated[float, bounded(0, 1, "m", hint=_METRES)] = 0.0
    """Travel of a sinusoidal motion along the optical axis, peak to peak [m]."""
    depth_period_s: Annotated[float, bounded(0.02, 1e9, "s")] = 8.6
    """Period of that motion [s]. Assumed."""
    kind: Literal["rings", "tissue", "several"] = "rings"
    """Print in the middle; every board has markers around it."""
    target: Annotated[int, bounded(0, 3)] = 0
    """Number of the patch that is the target; only `several` has others than 0."""
    tilt_deg: Annotated[float, bounded(-85, 85, "deg")] = 0.0
    """Rotation of the board about an axis in its plane through its centre [deg]."""
    tilt_axis_deg: Angle = 0.0
    """Direction of that axis in the picture: 0 right, 90 up [deg]."""

    @property
    def quaternion(self) -> rotation.Quaternion:
        """Orientation of the board, base_from_board, scalar first."""
        axis = radians(self.tilt_axis_deg)
        return rotation.about((cos(axis), -sin(axis), 0.0), radians(self.tilt_deg))

    @property
    def slope(self) -> float:
        """Depth per distance along the board's steepest direction [m/m], >= 0."""
        return tan(radians(abs(self.tilt_deg)))

    @property
    def relief_m(self) -> float:
        """How far a corner is ahead of the centre, or behind it, because of the tilt [m]."""
        axis = radians(self.tilt_axis_deg)
        arm = boards.SIZE_M / 2 * (abs(cos(axis)) + abs(sin(axis)))
        return arm * sin(radians(abs(self.tilt_deg)))

    @model_validator(mode="after")
    def _target_is_there(self) -> Self:
        count = 4 if self.kind == "several" else 1
        if self.target >= count:
            raise ConfigError(
                f"target {self.target}: board {self.kind} has {count}, from 0", "use a lower number"
            )
        return self


class Light(Strict):
    """Illumination; the parts add up."""

    room: _Factor = 1.0
    """Ambient light, and some from above [1]. Assumed."""
    tip: _Factor = 1.0
    """Light guide next to the camera [1]. Assumed."""
    falls_off: bool = False
    """Whether the tip's light falls with the square of the distance, and off its axis; at 50 mm it
    is as bright as without."""
    back: _Share = 0.0
    """Light emitted by the board itself, as if lit from behind or a screen [1]. Assumed."""


class CameraSettings(Strict):
    """Tip camera and video chain; by default ideal except for geometry, frame rate and latency."""

    width: Annotated[int, bounded(16, 4096, "px")] = 640
    """Width of the picture [px]."""
    height: Annotated[int, bounded(16, 4096, "px")] = 480
    """Height of the picture [px]."""
    projection: Literal["pinhole", "equidistant"] = "pinhole"
    """equidistant is a fisheye, remapped from a wider picture; it takes 3 times as long."""
    fovy_deg: Annotated[float, bounded(1, 170, "deg", hint="give degrees")] = 85.0
    """Full vertical field of view of a pinhole [deg]. Assumed; f = 262 px at 480 rows."""
    diagonal_deg: Annotated[float, bounded(40, 150, "deg", hint="give degrees")] = 120.0
    """Full field of view of a fisheye across the corners [deg]. Assumed: 120 and 140 are common."""
    mask: Literal["none", "octagon", "circle"] = "none"
    """Visible part of the picture."""
    vignette: _Share = 0.0
    """Loss of light in the corners [1], growing with the fourth power of the radius. Assumed."""
    gain: Annotated[float, bounded(0.001, 16)] = 1.0
    """Factor on the brightness; values above white are clipped [1]. Assumed."""
    exposure_s: Annotated[float, bounded(0, 0.1, "s", hint="give seconds")] = 0.0
    """Exposure time, centred on the time of the frame [s]; 0 gives no motion blur. Assumed."""
    sub_exposures: Annotated[int, bounded(1, 31)] = 5
    """Number of pictures averaged over an exposure, odd; one is drawn if nothing moves by a pixel.
    Assumed: at 7 px of blur they are 1.4 px apart."""
    noise: Annotated[float, bounded(0, 64, "grey levels")] = 0.0
    """Standard deviation of the sensor's noise [grey levels of 255]. Assumed."""
    jpeg_quality: Annotated[int, bounded(0, 100)] = 0
    """Quality at which every frame is JPEG-coded and decoded; 0 for no coding. Assumed."""
    frame_rate_hz: Annotated[float, bounded(0.1, 200, "Hz")] = 25.0
    """Exposures per second [Hz]. Assumed."""
    latency_s: Latency = 0.4
    """Exposure to delivery [s]. Source: 0.4 s loop latency, thesis ch. 7; all of it in the video
    chain: assumed."""
    nominal_latency_s: Latency | None = None
    """Latency from which the camera computes the time of exposure [s]; the true one if None."""
    jitter_s: Jitter = 0.0
    """Half width of the uniform variation of the latency [s]. Assumed."""
    drop_fraction: Lost = 0.0
    """Share of the frames that never arrive [1]. Assumed."""
    repeat_fraction: Lost = 0.0
    """Share of the frames that are replaced by a copy of the previous one [1]. Assumed."""

    truth_noise_px: Annotated[float, bounded(0, 100, "px")] = 0.0
    """Standard deviation of the noise that `--vision truth` adds to each coordinate [px]; pictures
    have their own noise."""
    background: bool = True
    """Whether `--vision truth` sees a background, from which it measures the rotation of the camera
    as pictures allow; with pictures, it depends on what they show."""

    @model_validator(mode="after")
    def _exposure_fits(self) -> Self:
        if self.sub_exposures % 2 == 0:
            raise ConfigError(f"sub_exposures {self.sub_exposures} is even", "use an odd number")
        if self.exposure_s * self.frame_rate_hz > 1:
            raise ConfigError(
                f"exposure_s {self.exposure_s:g} is longer than a frame of "
                f"{1 / self.frame_rate_hz:g} s",
                "use less",
            )
        return self

    @model_validator(mode="after")
    def _picture_fits(self) -> Self:
        if (pixels := self.width * self.height) > LARGEST_PICTURE_PX:
            raise ConfigError(
                f"a picture of {self.width} x {self.height} px has {pixels} pixels, wanted up to "
                f"{LARGEST_PICTURE_PX}",
                "use a smaller width or height",
            )
        if self.projection == "equidistant":
            corner = radians(self.diagonal_deg) / 2
            longest = FISHEYE_MARGIN * max(self.width, self.height) * tan(corner) / corner
            if longest > LARGEST_SHOT_PX:
                raise ConfigError(
                    f"a fisheye of {self.diagonal_deg:g} deg and {self.width} x {self.height} px "
                    f"needs a picture of {longest:.0f} px, wanted up to {LARGEST_SHOT_PX} px",
                    "use a smaller width, height or diagonal_deg",
                )
        return self


class PoseTrackerSettings(Strict):
    """An optical tracker of the tip's pose, such as the OptiTrack system used in the thesis.

    The model used there is not known, so all values are assumed: those of a small system.
    """

    rate_hz: Annotated[float, bounded(0.1, 1000, "Hz")] = 100.0
    """Poses per second [Hz]. Assumed."""
    latency_s: Latency = 0.010
    """Exposure to delivery [s]. Assumed: one period."""
    position_noise_m: Annotated[float, bounded(0, 0.1, "m", hint=_METRES)] = 0.0002
    """Standard deviation along each axis [m]. Assumed."""
    rotation_noise_deg: Annotated[float, bounded(0, 30, "deg")] = 0.05
    """Standard deviation about each axis [deg]. Assumed."""
    drop_fraction: Lost = 0.0
    """Share of the poses that never arrive [1]. Assumed."""


class Shaft(Event):
    """A permanent change of the shaft, at constant rate."""

    kind: Literal["bend", "roll"]
    """bend adds to `shaft_bend_deg`; roll turns the section about the optical axis at rest,
    clockwise as seen by the camera, so that the scene appears to turn counter-clockwise."""
    by_deg: ShaftBend
    """Change [deg]."""


class Push(Event):
    """A force on the tip across the shaft, half a sine: F = force sin(pi (t - start) / over)."""

    force_n: Annotated[float, bounded(0, 10, "N")]
    """Largest force [N]."""
    direction_deg: Angle = 0.0
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
    distance_m: Annotated[float, bounded(0.002, 1.5, "m", hint=_METRES)]
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
