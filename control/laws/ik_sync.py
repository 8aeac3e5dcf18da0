"""Inverse kinematics with time stamps: each frame is related to the handles at its exposure.

`ik` combines the present handle angles with the pixel of an old frame. This controller uses the
handle angles at the exposure of the frame, and the target's distance from the markers. The only
remaining effect of the latency is the target's motion in the meantime.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import Annotated

from endolock.control.laws.inverse_kinematics import IKMemory, InverseKinematics, aimed
from endolock.control.transmission import linear_process
from endolock.control.transmission.kinematics import SectionGeometry
from endolock.hw.api import Calibration, State
from endolock.hw.history import AngleHistory
from endolock.hw.strict import bounded
from endolock.hw.strict_fields import settle
from endolock.vision import camera_model
from endolock.vision.observation import Observation, Status


@dataclass(frozen=True, kw_only=True)
class IKSyncSettings:
    """Prior knowledge of the controller."""

    target_distance_m: linear_process.Depth = 0.12
    """Depth of the target until markers measure it [m], 0.001 to 10. Source: 12 cm, thesis ch.
    6."""
    bend_per_handle: linear_process.Slope = linear_process.BEND_PER_HANDLE
    """Bend per handle angle [rad/rad], 0.001 to 100. Assumed: the slope of the default
    instrument."""
    settle_s: Annotated[float, bounded(0.001, 1000, "s")] = 0.1
    """Time constant with which the handles approach their aim [s], 0.001 to 1000. Assumed: averages
    pixel noise over two frames, and leaves a gain margin."""

    def __post_init__(self) -> None:
        settle(self, "ik_sync")


@dataclass
class IKSyncMemory(IKMemory):
    """State of the controller."""

    distance_m: float | None = None
    """Depth of the target, as last measured by markers [m]."""
    history: AngleHistory = field(default_factory=AngleHistory)
    """Past handle angles."""


class SynchronousIK(InverseKinematics):
    """Aims at the position of the target at the exposure.

    Args:
        calibration: turns pixels into rays.
        settings: prior knowledge; the defaults if None.
        geometry: lengths of the section; the defaults if None.
    """

    memory: IKSyncMemory

    def __init__(
        self,
        calibration: Calibration,
        settings: IKSyncSettings | None = None,
        geometry: SectionGeometry | None = None,
    ) -> None:
        super().__init__(calibration, geometry=geometry)
        self._believed = settings or IKSyncSettings()
        self.memory = IKSyncMemory()

    def reset(self, state: State) -> None:
        """Hold the handles at their present goals."""
        handles = state.goal[0], state.goal[1]
        self.memory = IKSyncMemory(goals=handles, aim=handles)

    def _look(self, state: State, observation: Observation | None) -> None:
        """Update the aim with a frame that shows the target; otherwise keep it."""
        memory, believed = self.memory, self._believed
        memory.history.append(state)
        if observation is None or observation.status is not Status.TRACKING:
            return
        if isfinite(observation.distance_m):
            memory.distance_m = observation.distance_m
        ray = camera_model.ray(self._calibration, observation.target_px)
        depth = memory.distance_m or believed.target_distance_m
        then = memory.history.at(observation.t_capture)
        memory.aim = aimed(self._geometry, believed.bend_per_handle, then, depth * ray)

    def _share(self, dt: float) -> float:
        return dt / (self._believed.settle_s + dt)
