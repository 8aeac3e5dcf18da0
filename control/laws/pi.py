"""PI control of the pixel error, the first controller of the thesis.

With e = (-(v - cy), u - cx) / f, the target's offset above and right of the centre in radians,

    handle = kp e + I,    I' = ki e,

on both axes. The error is held between frames, and is 0 while the target is not seen. I starts at
the present handle angle, so the start is bumpless. The gains hold for one distance only: the image
of a close target moves more per handle angle.

Reference:
    S. D. Frijnts, Design of a target lock for an endoscope using TeleFLEX, University of Twente,
    2015, section 4.2, p. 31 (start of the integrator, one distance).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Calibration, Command, State
from endolock.hw.strict import bounded
from endolock.hw.strict_fields import settle
from endolock.vision import camera_model
from endolock.vision.observation import Observation, Status


@dataclass(frozen=True, kw_only=True)
class PISettings:
    """Gains of the PI controller."""

    kp: Annotated[float, bounded(0, 100, "rad/rad")] = 0.1
    """Handle angle per error [rad/rad], 0 to 100. Calibrated, with `ki`, on the thesis' stroke
    peaks and its improvement by compensation, for 12 cm, among gains with which the tip follows and
    that leave a gain margin of 1.5 (scripts/studies/controller_calibration.py); the thesis' own
    gains are not in the excerpt."""
    ki: Annotated[float, bounded(0, 1000, "1/s")] = 1.6
    """Handle speed per error [1/s], 0 to 1000. Calibrated, as `kp`."""

    def __post_init__(self) -> None:
        settle(self, "pi")


@dataclass
class PIMemory:
    """State of the controller."""

    integral: Pair = (0.0, 0.0)
    """Integral part I [rad]."""
    error: Pair = (0.0, 0.0)
    """Error in the newest frame [rad]; 0 if it did not show the target."""
    t: float | None = None
    """Time of the last tick [s]."""


class PI:
    """PI controller of both axes; the integral of an axis at its limit stops.

    Args:
        calibration: turns pixels into angles.
        settings: the gains; the defaults if None.
    """

    def __init__(self, calibration: Calibration, settings: PISettings | None = None) -> None:
        self._calibration = calibration
        self.gains = self._gains(settings or PISettings())
        """kp [rad/rad] and ki [1/s] in use."""
        self.memory = PIMemory()

    def reset(self, state: State) -> None:
        """Start from the present goals of the handles, without an error."""
        self.memory = PIMemory(integral=(state.goal[0], state.goal[1]))

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Control the error in the newest frame; see `Controller.update`."""
        memory = self.memory
        if observation is not None:
            memory.error = error(self._calibration, observation)
        dt = 0.0 if memory.t is None else t - memory.t
        memory.t = t
        kp, ki = self.gains
        # An axis clipped at its upper (+1) or lower (-1) limit integrates only away from it.
        up_down, left_right = (
            i if clipped * e > 0 else i + ki * e * dt
            for i, e, clipped in zip(memory.integral, memory.error, state.clipped, strict=True)
        )
        memory.integral = up_down, left_right
        return Command(position=(up_down + kp * memory.error[0], left_right + kp * memory.error[1]))

    @staticmethod
    def _gains(settings: PISettings) -> Pair:
        return settings.kp, settings.ki


def error(calibration: Calibration, observation: Observation) -> Pair:
    """Offset of the target above and right of the centre [rad]; 0 if it is not tracked."""
    if observation.status is not Status.TRACKING:
        return 0.0, 0.0
    right, down = camera_model.offset(calibration, observation.target_px)
    return -down / calibration.focal_px, right / calibration.focal_px
