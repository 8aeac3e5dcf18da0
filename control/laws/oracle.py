"""The oracle: a floor, not a controller. It is handed the truth, and so has no latency.

It knows the bend and where the target is seen now, follows the target's motion with a parabola,
and aims at where it will be when a command arrives. The handle angle comes from a hysteresis model
of the very instrument, run on the measured handles; what the model gets wrong is seen in the true
bend and added. What is left is the lag of servo and tip, and the model's errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from endolock.control.transmission import kinematics, linear_process
from endolock.control.transmission.kinematics import Pair, SectionGeometry
from endolock.control.transmission.plays import ONE_PLAY, Hysteresis, Plays, play_step
from endolock.hw.api import Calibration, Command, ConfigError, State, TruthSample
from endolock.vision import camera_model
from endolock.vision.observation import Observation

SPAN = 5
"""So many past places of the target carry the parabola."""


@dataclass(frozen=True, kw_only=True)
class OracleSettings:
    """What it knows besides."""

    plays: Plays = ONE_PLAY
    """Hysteresis of the instrument; that of the twin in use is given by whoever makes the law."""
    lead_s: float = linear_process.LAG_S + linear_process.COMMAND_DELAY_S
    """Command to motion [s], >= 0: servo and tip, one and a half control periods."""
    correct_s: float = 0.15
    """Time constant with which the model is corrected [s], > 0. Source: measured; a quicker one
    rings, for the servo takes 0.18 s through the loop."""
    reversal_rad: float = 0.003
    """Smaller changes of the wanted bend do not turn the handles back [rad], >= 0. Assumed."""

    def __post_init__(self) -> None:
        if not (self.lead_s >= 0 and self.correct_s > 0 and self.reversal_rad >= 0):
            raise ConfigError(
                f"oracle: lead_s {self.lead_s:g}, correct_s {self.correct_s:g}, reversal_rad "
                f"{self.reversal_rad:g}",
                "use 0 or more, and a correct_s above 0",
            )


@dataclass
class OracleMemory:
    """What the law remembers."""

    places: tuple[list[float], list[float]] = field(default_factory=lambda: ([], []))
    """z_i of the plays of both axes [rad]."""
    offset: Pair = (0.0, 0.0)
    """True bend less that of the model [rad]."""
    targets: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Times [s] and places of the target in base axes [m]."""
    wanted: Pair | None = None
    """Bend that is wanted, behind the play of `reversal_rad` [rad]."""
    t: float | None = None
    """Of the last tick [s]."""


class Oracle:
    """Aims at the true target.

    Args:
        calibration: turns true pixels into rays.
        settings: what it knows of the instrument.
        truth: tells the truth now.
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
        """Start anew; the plays are taken to be centred on the handles."""
        count = len(self._settings.plays.radii)
        one, other = ([h] * count for h in state.position)
        self.memory = OracleMemory(places=(one, other))

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Look at the truth and aim; what vision says is ignored. See `Controller.update`."""
        memory, settings = self.memory, self._settings
        truth = self._truth()
        if np.isfinite(truth.target_px).all() and truth.distance_m > 0:
            ray = camera_model.ray(self._calibration, truth.target_px)
            position, rotation = kinematics.forward(self._geometry, truth.plant.bend_rad)
            place = position + rotation @ (truth.distance_m * ray)
            memory.targets = [*memory.targets[1 - SPAN :], (t, *place.tolist())]
        bend = kinematics.aim(self._geometry, self._ahead(t + settings.lead_s))
        reach = settings.reversal_rad
        before = memory.wanted or bend
        one, other = (play_step(w, b, reach) for w, b in zip(before, bend, strict=True))
        memory.wanted = one, other
        dt = 0.0 if memory.t is None else t - memory.t
        share = 1.0 if memory.t is None else dt / (settings.correct_s + dt)
        memory.t = t
        handles, offsets = [], []
        for axis, places in enumerate(memory.places):
            model = Hysteresis(settings.plays, places)
            missed = truth.plant.bend_rad[axis] - model.follow(state.position[axis])
            offset = memory.offset[axis] + share * (missed - memory.offset[axis])
            handles.append(model.handle_for(memory.wanted[axis] - offset))
            offsets.append(offset)
        memory.offset = offsets[0], offsets[1]
        return Command(position=handles)

    def _ahead(self, t: float) -> np.ndarray:
        """Place of the target at a time [m], by a parabola through its last places."""
        if not self.memory.targets:
            return np.array([0.0, 0.0, 1.0])
        times, *places = np.array(self.memory.targets).T
        degree = min(2, len(times) - 1)
        curve = np.polynomial.polynomial.polyfit(times - t, np.array(places).T, degree)
        return np.asarray(curve[0], np.float64)
