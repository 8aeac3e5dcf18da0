"""Inverse kinematics, the thesis' second law: find the target, then aim at it.

The bend is taken to be handle x gain, the target to lie at a fixed depth on the ray of its pixel.
As in the thesis, the handle is that of *now* and the pixel that of an *old* frame, which makes the
law an integrator around the latency; so it follows its aim with a finite rate.
"""

from __future__ import annotations

from dataclasses import dataclass

from endolock.control import kinematics
from endolock.control.kinematics import SectionGeometry
from endolock.hw.api import Calibration, Command, ConfigError, State
from endolock.vision import camera_model
from endolock.vision.observation import Observation, Status


@dataclass(frozen=True, kw_only=True)
class IKSettings:
    """What the law believes."""

    target_distance_m: float = 0.12
    """Depth of the target, whatever it really is [m], > 0. Source: 12 cm, thesis ch. 6."""
    bend_per_handle: float = 0.97
    """Bend per handle angle in the middle of the hysteresis [rad/rad], > 0. Assumed: the slope of
    the default instrument."""
    rate_per_s: float = 1.8
    """Share of the remaining way that the handles go per second [1/s], > 0. Assumed: pi/4 over
    0.44 s, the gain margin of 2 of an integrator with the dead time of video, tick and servo."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 < value < float("inf"):
                raise ConfigError(f"ik: {name} is {value:g}; use a finite number above 0")


class InverseKinematics:
    """Aims at where the target seems to be.

    Args:
        calibration: turns pixels into rays.
        settings: what the law believes; the defaults if None.
        geometry: lengths of the section; the defaults if None.
    """

    def __init__(
        self,
        calibration: Calibration,
        settings: IKSettings | None = None,
        geometry: SectionGeometry | None = None,
    ) -> None:
        self._calibration = calibration
        self._settings = settings or IKSettings()
        self._geometry = geometry or SectionGeometry()
        self._handles = self._aim = (0.0, 0.0)
        self._t: float | None = None

    def reset(self, state: State) -> None:
        """Stay where the handles are."""
        self._handles = self._aim = (state.position[0], state.position[1])
        self._t = None

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Aim anew with each frame, and follow; without a target, stay. See `Controller.update`."""
        if observation is not None:
            if observation.status is Status.TRACKING:
                self._aim = self._aimed(state, observation.target_px)
            else:
                self._aim = self._handles
        dt = 0.0 if self._t is None else t - self._t
        self._t = t
        share = min(1.0, self._settings.rate_per_s * dt)
        (up_down, left_right), (aim_up, aim_right) = self._handles, self._aim
        self._handles = (
            up_down + share * (aim_up - up_down),
            left_right + share * (aim_right - left_right),
        )
        return Command(position=self._handles)

    def _aimed(self, state: State, pixel: tuple[float, float]) -> tuple[float, float]:
        gain = self._settings.bend_per_handle
        bend = (gain * state.position[0], gain * state.position[1])
        position, rotation = kinematics.forward(self._geometry, bend)
        ray = camera_model.ray(self._calibration, pixel)
        target = position + rotation @ (self._settings.target_distance_m * ray)
        up_down, left_right = kinematics.aim(self._geometry, target)
        return up_down / gain, left_right / gain
