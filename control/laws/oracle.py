"""Oracle: a lower bound of the error, not a controller. It receives the truth without latency.

It knows the present bend and pixel of the target, extrapolates the target's motion by a parabola,
and aims at its position when the command takes effect. The handle angle comes from a hysteresis
model of the same instrument, run on the measured handle angles and corrected by the true bend. The
remaining error is from the lag of servo and tip, and from the model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from endolock.control.transmission import kinematics, linear_process
from endolock.control.transmission.kinematics import Pair, SectionGeometry
from endolock.control.transmission.plays import ONE_PLAY, Hysteresis, Plays, play_step
from endolock.hw.api import Calibration, Command, State, TruthSample
from endolock.hw.strict import bounded
from endolock.hw.strict_fields import settle
from endolock.vision import camera_model
from endolock.vision.observation import Observation

SPAN = 5
"""Number of past target positions used for the parabola."""


@dataclass(frozen=True, kw_only=True)
class OracleSettings:
    """Knowledge in addition to the truth."""

    plays: Plays = ONE_PLAY
    """Hysteresis of the instrument; the caller gives that of the twin in use."""
    lead_s: Annotated[float, bounded(0, 30, "s")] = (
        linear_process.LAG_S + linear_process.COMMAND_DELAY_S
    )
    """Delay from command to motion [s], 0 to 30: servo and tip, one and a half control periods."""
    correct_s: Annotated[float, bounded(0.001, 1e9, "s")] = 0.15
    """Time constant of the model correction [s], 0.001 to 1e9. Source: measured; a shorter one
    oscillates, because the servo takes 0.18 s through the loop."""
    reversal_rad: Annotated[float, bounded(0, 1, "rad")] = 0.003
    """Changes of the desired bend below this do not reverse the handles [rad], 0 to 1. Assumed."""

    def __post_init__(self) -> None:
        settle(self, "oracle")


@dataclass
class OracleMemory:
    """State of the controller."""

    outputs: tuple[list[float], list[float]] = field(default_factory=lambda: ([], []))
    """Outputs z_i of the plays of both axes [rad]."""
    offset: Pair = (0.0, 0.0)
    """True bend less that of the model [rad]."""
    targets: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Times [s] and positions of the target in base axes [m]."""
    desired_bend: Pair | None = None
    """Desired bend, after the play of `reversal_rad` [rad]."""
    t: float | None = None
    """Time of the last tick [s]."""


class Oracle:
    """Aims at the true target.

    Args:
        calibration: turns true pixels into rays.
        settings: knowledge of the instrument.
        truth: returns the truth now.
        geometry: lengths of the section; the defaults if None.
    """

    def __init__(
        self,
        calibration: Calibration,
        settings: OracleSettings,
        truth: Callable[[], TruthSample],
        geometry: SectionGeometry | None = None,
    ) -> None:
        self._calibration, self._settings, self._truth = calibration, settings, truth
        self._geometry = geometry or SectionGeometry()
        self.memory = OracleMemory()

    def reset(self, state: State) -> None:
        """Start again, with the plays centred on the handle angles."""
        count = len(self._settings.plays.radii)
        up_down, left_right = ([h] * count for h in state.position)
        self.memory = OracleMemory(outputs=(up_down, left_right))

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Aim with the truth; the observation is ignored. See `Controller.update`."""
        memory, settings = self.memory, self._settings
        truth = self._truth()
        if np.isfinite(truth.target_px).all() and truth.distance_m > 0:
            ray = camera_model.ray(self._calibration, truth.target_px)
            position, rotation = kinematics.forward(self._geometry, truth.plant.bend_rad)
            target = position + rotation @ (truth.distance_m * ray)
            memory.targets = [*memory.targets[1 - SPAN :], (t, *target.tolist())]
        bend = kinematics.aim(self._geometry, self._ahead(t + settings.lead_s))
        reach = settings.reversal_rad
        before = memory.desired_bend or bend
        up_down, left_right = (play_step(d, b, reach) for d, b in zip(before, bend, strict=True))
        memory.desired_bend = up_down, left_right
        dt = 0.0 if memory.t is None else t - memory.t
        share = 1.0 if memory.t is None else dt / (settings.correct_s + dt)
        memory.t = t
        handles, offsets = [], []
        for axis, outputs in enumerate(memory.outputs):
            model = Hysteresis(settings.plays, outputs)
            missed = truth.plant.bend_rad[axis] - model.follow(state.position[axis])
            offset = memory.offset[axis] + share * (missed - memory.offset[axis])
            handles.append(model.handle_for(memory.desired_bend[axis] - offset))
            offsets.append(offset)
        memory.offset = offsets[0], offsets[1]
        return Command(position=handles)

    def _ahead(self, t: float) -> np.ndarray:
        """Position of the target at a time [m], by a parabola through its last positions."""
        if not self.memory.targets:
            return np.array([0.0, 0.0, 1.0])
        times, *positions = np.array(self.memory.targets).T
        degree = min(2, len(times) - 1)
        curve = np.polynomial.polynomial.polyfit(times - t, np.array(positions).T, degree)
        return np.asarray(curve[0], np.float64)
