"""PI control of the pixel error, the thesis' first law.

With e = (-(v - cy), u - cx) / f, the target's offset above and right of the centre in radians,

    handle = kp e + I,    I' = ki e,

on both axes alike. The error is held between frames; while the target is not seen, it is nothing.
I starts at the present handle angle, so that nothing jumps. The gains hold for one distance only: a
handle moves the picture of a close target more.

Reference:
    S. D. Frijnts, Design of a target lock for an endoscope using TeleFLEX, University of Twente,
    2015, section 4.2, p. 31 (start of the integrator, one distance).
"""

from __future__ import annotations

from dataclasses import dataclass

from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Calibration, Command, ConfigError, State
from endolock.vision import camera_model
from endolock.vision.observation import Observation, Status


@dataclass(frozen=True, kw_only=True)
class PISettings:
    """Gains of the PI law."""

    kp: float = 0.1
    """Handle angle per error [rad/rad], >= 0. Calibrated, with `ki`, on the thesis' stroke peaks
    and what compensation gains, for 12 cm, among gains with which the tip follows and that leave
    a gain margin of 1.5 (scripts/studies/controller_calibration.py); its own gains are not in the
    excerpt."""
    ki: float = 1.6
    """Handle speed per error [1/s], >= 0. Calibrated, as `kp`."""

    def __post_init__(self) -> None:
        for name in ("kp", "ki"):
            value = getattr(self, name)
            if not 0 <= value < float("inf"):
                raise ConfigError(f"pi: {name} is {value:g}", "use a finite number, 0 or more")


@dataclass
class PIMemory:
    """What the law remembers."""

    integral: Pair = (0.0, 0.0)
    """[rad]"""
    error: Pair = (0.0, 0.0)
    """Of the newest frame [rad]; 0 where it did not show the target."""
    t: float | None = None
    """Of the last tick [s]."""


class PI:
    """PI law on both axes; integration stops on an axis that cannot go further.

    Args:
        calibration: turns pixels into angles.
        settings: the gains; the defaults if None.
    """

    def __init__(self, calibration: Calibration, settings: PISettings | None = None) -> None:
        self._calibration = calibration
        self.gains = self._gains(settings or PISettings())
        """kp [rad/rad] and ki [1/s] in force."""
        self.memory = PIMemory()

    def reset(self, state: State) -> None:
        """Start from where the handles are, without an error."""
        self.memory = PIMemory(integral=(state.position[0], state.position[1]))

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Move the handles against the error of the newest frame; see `Controller.update`."""
        memory = self.memory
        if observation is not None:
            memory.error = error(self._calibration, observation)
        dt = 0.0 if memory.t is None else t - memory.t
        memory.t = t
        kp, ki = self.gains
        # An axis that was clipped (+1 from above, -1 from below) integrates only its way back.
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
    """Offset of the target above and right of the centre [rad]; 0 where it is not tracked."""
    if observation.status is not Status.TRACKING:
        return 0.0, 0.0
    right, down = camera_model.offset(calibration, observation.target_px)
    return -down / calibration.focal_px, right / calibration.focal_px
