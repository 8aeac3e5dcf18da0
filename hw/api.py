"""The interface between controllers and what turns the handles: a twin, an emulator or a bench.

Time belongs to a `Clock`: calling `sleep_until` makes the world advance, so nothing here has
a `step()`. Everything is SI; axes are always (up_down, left_right), pixels (u right, v down).
Frames of reference: *base* is the tip camera at rest in OpenCV axes (x right, y down, z distal);
*board* has x right and y down on its printed face and z into the board, so that a board seen
straight from the front is aligned with the camera.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from endolock.hw import rotation
from endolock.hw.errors import CommandError as CommandError
from endolock.hw.errors import ConfigError as ConfigError
from endolock.hw.errors import DeviceFault as DeviceFault
from endolock.hw.errors import EndolockError as EndolockError
from endolock.hw.errors import Fault as Fault
from endolock.hw.errors import HardwareError as HardwareError
from endolock.hw.errors import LinkError as LinkError
from endolock.hw.errors import LinkLost as LinkLost
from endolock.hw.errors import PortBusy as PortBusy
from endolock.hw.errors import PortGone as PortGone
from endolock.hw.errors import StateError as StateError
from endolock.hw.frozen import Frozen

AXES = ("up_down", "left_right")
"""The two handle axes, in the order used everywhere."""

PERIOD_S = 0.020
"""Control period [s]: 50 Hz, two ticks per frame."""

Vector = NDArray[np.float64]
Image = NDArray[np.uint8]


class Clock(Protocol):
    """The one clock that stamps frames and states; sleeping on it makes time pass."""

    @property
    def realtime(self) -> bool:
        """Whether it follows wall-clock time."""

    @property
    def timestep_s(self) -> float:
        """Its resolution [s]; 0 where time is continuous."""

    def now(self) -> float:
        """Time since the rig was created [s]."""

    def sleep_until(self, t: float) -> float:
        """Return at `t` [s], or at once if it has passed; on a grid, at the first point >= `t`."""


class Mode(StrEnum):
    """What the handle motors are doing."""

    DISCONNECTED = "disconnected"
    DISABLED = "disabled"
    """No torque."""
    ENABLED = "enabled"
    """The handles follow commands."""
    HOLDING = "holding"
    """Torque on, goal frozen; the next command continues from there."""
    FAULT = "fault"
    """Goal frozen by a latched fault, until `clear_fault()` and `enable()`."""

    @property
    def driven(self) -> bool:
        """Whether torque is on and the goal may be moved."""
        return self in (Mode.ENABLED, Mode.HOLDING)


@dataclass(frozen=True, kw_only=True)
class Limits(Frozen):
    """Limits of position and speed, per axis."""

    position_rad: tuple[tuple[float, float], ...]
    """Lowest and highest handle angle of each axis [rad]."""
    velocity_rad_s: tuple[float, ...]
    """Maximum rate of change of the goal of each axis [rad/s]."""


@dataclass(frozen=True, kw_only=True)
class Command:
    """Handle angles to go to."""

    position: Sequence[float]
    """Handle angles [rad], (up_down, left_right)."""
    valid_for: float = 0.2
    """The handles hold unless another command comes within this time [s]. Assumed."""


@dataclass(frozen=True, kw_only=True)
class State(Frozen):
    """State of the handles after one exchange."""

    t: float
    """Clock time at which the positions were measured [s]."""
    t_err: float
    """Half-width of the uncertainty of `t` [s]."""
    seq: int
    """Counts exchanges with the device from 0."""
    position: tuple[float, ...]
    """Measured handle angles [rad]."""
    velocity: tuple[float, ...]
    """Measured handle speeds [rad/s]."""
    current: tuple[float, ...]
    """Motor currents [A]."""
    goal: tuple[float, ...]
    """Goals in force after this exchange [rad]: limited, slewed, quantised."""
    clipped: tuple[int, ...]
    """Per axis +1 (-1) where the command was above (below) the goal sent; 0 where equal."""
    fresh: bool
    """Whether the device answered this exchange with positions that can be; if not, the
    measurements are the last ones."""
    mode: Mode
    """Mode after this exchange."""
    device_tick: int
    """The device's own clock [ms]; it stops when the device does."""


class Actuators(Protocol):
    """Two handle motors in position mode, on a twin, an emulator or a bench."""

    @property
    def clock(self) -> Clock:
        """The clock that stamps the states."""

    @property
    def axes(self) -> tuple[str, ...]:
        """Axis names, in the order of every tuple here."""

    @property
    def limits(self) -> Limits:
        """Limits of position and speed, counted from the present zero."""

    @property
    def mode(self) -> Mode:
        """Present mode."""

    def connect(self) -> None:
        """Open the device; afterwards the mode is DISABLED."""

    def home(self) -> None:
        """Make the present position the zero of both axes, once several readings confirm it.

        Raises:
            StateError: the motors are enabled.
            LinkLost, DeviceFault: the handles do not answer, or readings do not agree; the zero
                stays.
        """

    def enable(self) -> State:
        """Switch torque on without a jump: the goal becomes the position, once it is confirmed.

        Where a load kept a handle behind its goal when torque was last on, and it still stands
        near there, the goal is ahead of it by as much.

        Raises:
            StateError: not connected, or a fault is latched.
            LinkLost, DeviceFault: the handles do not answer, or readings do not agree; torque
                stays off.
        """

    def exchange(self, command: Command | None) -> State:
        """Send a command, or None to continue as before, and read the state, in one transaction.

        Raises:
            CommandError: wrong length, or NaN or infinite; the previous goal stays.
            StateError: not connected, or a command while not enabled.
            LinkLost, DeviceFault: latched; raised again until `clear_fault()`.
        """

    def history(self, t: float) -> State:
        """Return the state at a past time `t` [s], interpolated between exchanges.

        Raises:
            LookupError: `t` lies outside the remembered span.
        """

    def hold(self) -> None:
        """Freeze the goals where they are and keep torque on; nothing is read."""

    def estop(self, why: str) -> None:
        """Emergency stop: at the next exchange the handles hold, and a fault is latched.

        May be called from any thread or signal handler, as by an emergency button or a supervisor.
        """

    def disable(self) -> None:
        """Switch torque off.

        Raises:
            HardwareError: a motor did not take the command; latched, like any other fault.
        """

    def clear_fault(self) -> None:
        """Clear a latched fault and reopen the device; the motors stay off until `enable()`.

        Raises:
            HardwareError: the device is not available yet; the fault stays latched.
        """

    def close(self) -> None:
        """Disable the motors and release the device; may be called twice."""

    def __enter__(self) -> Self:
        """Connect."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close, without hiding an exception on its way out."""


@dataclass(frozen=True, kw_only=True)
class Calibration(Frozen):
    """Geometry of a camera: a ray at the angle theta to the axis appears at the radius r.

    r = f tan(theta) for a pinhole, r = f theta for an equidistant fisheye, before distortion.
    """

    width: int
    height: int
    focal_px: float
    """Focal length f along u [px]."""
    centre_px: tuple[float, float]
    """Principal point (u, v) [px]; the centre of the first pixel is (0, 0)."""
    aspect: float = 1.0
    """Focal length along v divided by that along u [1]; 1 for square pixels."""
    projection: Literal["pinhole", "equidistant"] = "pinhole"
    distortion: tuple[float, ...] = ()
    """OpenCV's coefficients: k1, k2, p1, p2, k3 of a pinhole, k1..k4 of a fisheye; empty for an
    ideal lens."""
    mask: Literal["none", "octagon", "circle"] = "none"
    """Visible part of the picture; see `vision.camera_model.in_picture`."""
    rms_px: float = 0.0
    """Reprojection error of the calibration, rms [px]; 0 for an exact geometry."""
    date: str = ""
    """Date of the calibration, YYYY-MM-DD; empty if it was not calibrated."""

    @property
    def matrix(self) -> Vector:
        """Camera matrix K, 3x3 [px]."""
        (cx, cy), f = self.centre_px, self.focal_px
        return np.array([[f, 0.0, cx], [0.0, f * self.aspect, cy], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, kw_only=True)
class Frame(Frozen):
    """One picture as it was delivered."""

    image: Image | None
    """RGB, height x width x 3, read-only; None where vision uses the ground truth instead."""
    t_capture: float
    """Estimated time of exposure [s]: t_available less the nominal latency."""
    t_available: float
    """Time of delivery [s]."""
    seq: int
    """Number of the exposure, from 0; gaps are frames that were lost."""
    dropped: int
    """Exposures between the previously returned frame and this one: lost or skipped."""
    repeated: bool = False
    """Whether this is the previous picture, delivered again under a new number."""


class Camera(Protocol):
    """A source of frames."""

    @property
    def calibration(self) -> Calibration:
        """Its geometry."""

    def latest(self) -> Frame | None:
        """Return the newest frame delivered, or None before the first; never blocks.

        Raises:
            HardwareError: the device has ended, or was silent for too long.
        """


@dataclass(frozen=True, kw_only=True)
class BoardGeometry(Frozen):
    """Markers and target of a printed board, in its own frame [m]."""

    dictionary: str
    """Name of the OpenCV ArUco dictionary."""
    markers: tuple[tuple[int, float, float, float], ...]
    """Id, centre (x, y) and side of each marker, black border included."""
    size_m: float
    """Side of the square board."""
    target: tuple[float, float] = (0.0, 0.0)
    """The point to be kept in the image centre."""

    def corners(self) -> dict[int, Vector]:
        """Corners of each marker, 4x3 [m]: top left, top right, bottom right, bottom left."""
        square = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
        return {marker: size * square + [x, y, 0] for marker, x, y, size in self.markers}


@dataclass(frozen=True, kw_only=True)
class Pose(Frozen):
    """Position and orientation of a rigid body in the base frame at time `t`."""

    t: float
    position: tuple[float, float, float]
    """[m]"""
    quaternion: tuple[float, float, float, float]
    """Scalar first, base_from_body."""

    @property
    def rotation_vector(self) -> tuple[float, float, float]:
        """The orientation as axis times angle [rad], at most pi long.

        Its first two components are the bend of a section whose tip this is.
        """
        return rotation.to_vector(self.quaternion)

    @property
    def matrix(self) -> Vector:
        """The orientation as a rotation matrix, 3x3, base_from_body."""
        return rotation.to_matrix(self.quaternion)


class PoseTracker(Protocol):
    """An external measurement of the tip as a rigid body, such as an optical tracker.

    The body's axes are those of the base frame when the section is straight.
    """

    def latest(self) -> Pose | None:
        """Return the newest pose delivered, with the time of its measurement; never blocks."""


@dataclass(frozen=True, kw_only=True)
class Plant(Frozen):
    """True state of a simulated endoscope at one instant, in the base frame."""

    bend_rad: tuple[float, float]
    """Bend of the section: components (up_down, left_right) of the tip's rotation vector [rad]."""
    tip: Pose
    """Pose of the tip camera, OpenCV axes."""
    board: Pose
    """Pose of the board."""
    backbone: Vector
    """Points along the section from its base to the camera, n x 3 [m]; read-only."""
    tension_handle_n: tuple[float, ...]
    """Tension of the wires up, right, down, left at the handle [N]."""
    tension_section_n: tuple[float, ...]
    """The same where they enter the bending section [N]."""


@dataclass(frozen=True, kw_only=True)
class TruthSample(Frozen):
    """Ground truth at one instant, which only a simulation knows."""

    t: float
    """The instant [s]."""
    target_px: tuple[float, float]
    """Exact projection of the target [px], also outside the picture; NaN behind the camera."""
    in_picture: bool
    """Whether that is within the picture."""
    hidden: bool
    """Whether something is between the camera and the target."""
    distance_m: float
    """Depth of the target along the optical axis [m]."""
    error_deg: float
    """Angle between the optical axis and the ray to the target [deg]."""
    plant: Plant


class Truth(Protocol):
    """Ground truth, for metrics, for the oracle and for vision without pictures."""

    def now(self) -> TruthSample:
        """Return the truth at the clock's present time."""

    def at_exposure(self, seq: int) -> TruthSample:
        """Return the truth at the exposure of frame `seq`, for frames of the last seconds.

        Raises:
            LookupError: the truth of that frame is no longer kept.
        """


class Line(Protocol):
    """The line that carries bytes to the handles and back."""

    def record(self, path: Path) -> None:
        """Log every byte from now on to a new file; an earlier log is closed.

        Raises:
            ConfigError: it cannot be written, or the earlier one could not be written to its end.
        """

    def stop_recording(self) -> None:
        """Close the log, if there is one.

        Raises:
            ConfigError: the log could not be written to its end.
        """


class Rig(Protocol):
    """A clock, handles and a camera: all that a target lock needs, simulated or real."""

    @property
    def clock(self) -> Clock:
        """Its one clock."""

    @property
    def actuators(self) -> Actuators:
        """The handles, guarded."""

    @property
    def camera(self) -> Camera:
        """The tip camera."""

    @property
    def overview(self) -> Camera | None:
        """A fixed camera that sees section and board, or None."""

    @property
    def board(self) -> BoardGeometry:
        """The target board in front of the tip."""

    @property
    def tracker(self) -> PoseTracker | None:
        """A pose tracker, or None."""

    @property
    def truth(self) -> Truth | None:
        """The ground truth; None on hardware."""

    @property
    def line(self) -> Line | None:
        """The line to the handles, or None."""

    def describe(self) -> Mapping[str, Any]:
        """Return its description for a run folder: plain values, by section."""
