"""Inverse kinematics, the second controller of the thesis: locate the target, then aim at it.

The bend is assumed to be handle angle x gain, and the target to lie at a fixed depth on the ray of
its pixel. As in the thesis, the handle angle is the *present* one and the pixel that of an *old*
frame, which makes the controller an integrator around the latency; so it approaches its aim at a
finite rate.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Annotated

from pydantic import StrictBool

from endolock.control.transmission import kinematics, linear_process
from endolock.control.transmission.kinematics import Pair, SectionGeometry
from endolock.hw.api import Calibration, Command, State, Vector
from endolock.hw.strict import bounded
from endolock.hw.strict_fields import settle
from endolock.vision import camera_model
from endolock.vision.observation import Observation, Status


@dataclass(frozen=True, kw_only=True)
class IKSettings:
    """Prior knowledge of the controller."""

    target_distance_m: linear_process.Depth = 0.12
    """Assumed depth of the target [m], 0.001 to 10. Source: 12 cm, thesis ch. 6."""
    bend_per_handle: linear_process.Slope = linear_process.BEND_PER_HANDLE
    """Bend per handle angle in the middle of the hysteresis [rad/rad], 0.001 to 100. Assumed: the
    slope of the default instrument."""
    rate_per_s: Annotated[float, bounded(0.001, 1000, "1/s")] = 1.8
    """Handle speed per remaining distance to the aim [1/s], 0.001 to 1000. Assumed: pi/4 over 0.44
    s, which gives a gain margin of 2 for an integrator with the dead time of video, tick and servo.
    Runs that are compared with the thesis use a rate calibrated for them
    (scripts/thesis/chapter_runs.py)."""
    measured_distance: StrictBool = False
    """Whether a measured depth replaces the assumed one. Source: no, thesis ch. 6."""

    def __post_init__(self) -> None:
        settle(self, "ik")


@dataclass
class IKMemory:
    """State of the controller."""

    goals: Pair = (0.0, 0.0)
    """Goals of the handles [rad]."""
    aim: Pair = (0.0, 0.0)
    """Handle angles that would centre the target, approached by the goals [rad]."""
    t: float | None = None
    """Time of the last tick [s]."""


class InverseKinematics:
    """Aims at the apparent position of the target.

    Args:
        calibration: turns pixels into rays.
        settings: prior knowledge; the defaults if None.
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
        """Hold the handles at their present goals."""
        handles = state.goal[0], state.goal[1]
        self.memory = IKMemory(goals=handles, aim=handles)

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Update the aim with each frame and approach it; hold without a target.

        See `Controller.update`.
        """
        memory = self.memory
        self._look(state, observation)
        dt = 0.0 if memory.t is None else t - memory.t
        memory.t = t
        share = self._share(dt)
        (up_down, left_right), (aim_up, aim_right) = memory.goals, memory.aim
        memory.goals = (
            up_down + share * (aim_up - up_down),
            left_right + share * (aim_right - left_right),
        )
        return Command(position=memory.goals)

    def _look(self, state: State, observation: Observation | None) -> None:
        """Update the aim."""
        if observation is None:
            return
        self.memory.aim = self.memory.goals
        if observation.status is Status.TRACKING:
            settings = self._settings
            ray = camera_model.ray(self._calibration, observation.target_px)
            measured = settings.measured_distance and isfinite(observation.distance_m)
            self.memory.aim = aimed(
                self._geometry,
                settings.bend_per_handle,
                (state.position[0], state.position[1]),
                (observation.distance_m if measured else settings.target_distance_m) * ray,
            )

    def _share(self, dt: float) -> float:
        """Fraction of the remaining distance covered in a time [1]."""
        return min(1.0, self._settings.rate_per_s * dt)


def aimed(geometry: SectionGeometry, slope: float, handles: Pair, target_m: Vector) -> Pair:
    """Handle angles that point the axis at a target seen from other handle angles [rad].

    Args:
        geometry: lengths of the section.
        slope: bend per handle angle [rad/rad].
        handles: handle angles when it was seen [rad].
        target_m: position of the target in camera axes then [m].
    """
    position, rotation = kinematics.forward(geometry, (slope * handles[0], slope * handles[1]))
    up_down, left_right = kinematics.aim(geometry, position + rotation @ target_m)
    return up_down / slope, left_right / slope
