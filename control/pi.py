"""PI control of the pixel error, the thesis' first law.

With e = (-(v - cy), u - cx) / f, the target's offset above and right of the centre in radians,

    handle = kp e + I,    I' = ki e,

on both axes alike. The error is held between frames; while the target is not seen, it is nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

from endolock.hw.api import Calibration, Command, ConfigError, State
from endolock.vision import camera_model
from endolock.vision.observation import Observation, Status


@dataclass(frozen=True, kw_only=True)
class PISettings:
    """Gains of the PI law."""

    kp: float = 0.18
    """Handle angle per error [rad/rad], >= 0. Assumed: the excerpt does not give the gains; with
    these the twin's stroke peaks stay within the picture, as the thesis' do (ch. 6)."""
    ki: float = 0.25
    """Handle speed per error [1/s], >= 0. Assumed, as `kp`."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 <= value < float("inf"):
                raise ConfigError(f"pi: {name} is {value:g}; use a finite number, 0 or more")


class PI:
    """PI law on both axes; integration stops on an axis that cannot go further.

    Args:
        calibration: turns pixels into angles.
        settings: the gains; the defaults if None.
    """

    def __init__(self, calibration: Calibration, settings: PISettings | None = None) -> None:
        self._calibration = calibration
        self._settings = settings or PISettings()
        self._integral = (0.0, 0.0)
        self._error = (0.0, 0.0)
        self._t: float | None = None

    def reset(self, state: State) -> None:
        """Start from where the handles are, without an error."""
        self._integral = (state.position[0], state.position[1])
        self._error = (0.0, 0.0)
        self._t = None

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Move the handles against the error of the newest frame; see `Controller.update`."""
        if observation is not None:
            self._error = (0.0, 0.0)
            if observation.status is Status.TRACKING:
                right, down = camera_model.offset(self._calibration, observation.target_px)
                focal = self._calibration.focal_px
                self._error = (-down / focal, right / focal)
        dt = 0.0 if self._t is None else t - self._t
        self._t = t
        kp, ki = self._settings.kp, self._settings.ki
        # An axis that was clipped (+1 from above, -1 from below) integrates only its way back.
        self._integral = tuple(  # type: ignore[assignment]
            i if clipped * e > 0 else i + ki * e * dt
            for i, e, clipped in zip(self._integral, self._error, state.clipped, strict=True)
        )
        return Command(
            position=tuple(i + kp * e for i, e in zip(self._integral, self._error, strict=True))
        )
