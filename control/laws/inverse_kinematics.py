"""Inverse kinematics, the thesis' second law: find the target, then aim at it.

The bend is taken to be handle x gain, the target to lie at a fixed depth on the ray of its pixel.
As in the thesis, the handle is that of *now* and the pixel that of an *old* frame, which makes the
law an integrator around the latency; so it follows its aim with a finite rate.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from endolock.control.transmission import kinematics, linear_process
from endolock.control.transmission.kinematics import Pair, SectionGeometry
from endolock.hw.api import Calibration, Command, ConfigError, State, Vector
from endolock.vision import camera_model
from endolock.vision.observation import Observation, Status


@dataclass(frozen=True, kw_only=True)
class IKSettings:
    """What the law believes."""

    target_distance_m: float = 0.12
    """Depth of the target, whatever it really is [m], > 0. Source: 12 cm, thesis ch. 6."""
    bend_per_handle: float = linear_process.BEND_PER_HANDLE
    """Bend per handle angle in the middle of the hysteresis [rad/rad], > 0. Assumed: the slope of
    the default instrument."""
    rate_per_s: float = 1.8
    """Share of the remaining way that the handles go per second [1/s], > 0. Assumed: pi/4 over
    0.44 s, the gain margin of 2 of an integrator with the dead time of video, tick and servo. Runs
    that stand beside the thesis' take a rate calibrated for them
    (scripts/thesis/chapter_runs.py)."""
    measured_distance: bool = False
    """Whether a depth that is seen replaces the assumed one. Source: not, thesis ch. 6."""

    def __post_init__(self) -> None:
        for name in ("target_distance_m", "bend_per_handle", "rate_per_s"):
            value = getattr(self, name)
            if not 0 < value < float("inf"):
                raise ConfigError(f"ik: {name} is {value:g}", "use a finite number above 0")


@dataclass
class IKMemory:
    """What the law remembers."""

    handles: Pair = (0.0, 0.0)
    """Where it wants the handles now [rad]."""
    aim: Pair = (0.0, 0.0)
    """Where they shall go [rad]."""
    t: float | None = None
    """Of the last tick [s]."""


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
        self.memory = IKMemory()

    def reset(self, state: State) -> None:
        """Stay where the handles are."""
        handles = state.position[0], state.position[1]
        self.memory = IKMemory(handles=handles, aim=handles)

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Aim anew with each frame, and follow; without a target, stay. See `Controller.update`."""
        memory = self.memory
        self._look(state, observation)
        dt = 0.0 if memory.t is None else t - memory.t
        memory.t = t
        share = self._share(dt)
        (up_down, left_right), (aim_up, aim_right) = memory.handles, memory.aim
        memory.handles = (
            up_down + share * (aim_up - up_down),
            left_right + share * (aim_right - left_right),
        )
        return Command(position=memory.handles)

    def _look(self, state: State, observation: Observation | None) -> None:
        """Renew the aim."""
        if observation is None:
            return
        self.memory.aim = self.memory.handles
        if observation.status is Status.TRACKING:
            settings = self._settings
            ray = camera_model.ray(self._calibration, observation.target_px)
            seen = settings.measured_distance and isfinite(observation.distance_m)
            self.memory.aim = aimed(
                self._geometry,
                settings.bend_per_handle,
                (state.position[0], state.position[1]),
                (observation.distance_m if seen else settings.target_distance_m) * ray,
            )

    def _share(self, dt: float) -> float:
        """Share of the remaining way that the handles go in a time [1]."""
        return min(1.0, self._settings.rate_per_s * dt)


def aimed(geometry: SectionGeometry, slope: float, handles: Pair, seen: Vector) -> Pair:
    """Handle angles that point the axis at what is seen with the handles at some angles [rad].

    Args:
        geometry: lengths of the section.
        slope: bend per handle angle [rad/rad].
        handles: when it was seen [rad].
        seen: the target in camera axes [m].
    """
    position, rotation = kinematics.forward(geometry, (slope * handles[0], slope * handles[1]))
    up_down, left_right = kinematics.aim(geometry, position + rotation @ seen)
    return up_down / slope, left_right / slope
