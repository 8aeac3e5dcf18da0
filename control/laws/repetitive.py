"""Repetitive control: learns the handle motion of one period, and replays it ahead of time.

The handles follow a table over the phase of a known period P. Each frame corrects the table at the
phase of its exposure, by a fraction of the error:

    h(t) = f(t + T),    f(t_frame) += g e(t_frame) / K,

so all errors that repeat, including hysteresis, vanish after some periods at any latency. Errors
that do not repeat are learned too late.

Reference:
    S. Hara et al., IEEE Trans. Automatic Control 33(7), 1988; D. A. Bristow et al., IEEE Control
    Systems 26(3), 2006 (iterative learning).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from endolock.control.laws.pi import error
from endolock.control.transmission import linear_process
from endolock.control.transmission.kinematics import Pair, SectionGeometry
from endolock.hw.api import PERIOD_S, Calibration, Command, State
from endolock.hw.strict import bounded
from endolock.hw.strict_fields import settle
from endolock.vision.observation import Observation, Status

LEAD_S = linear_process.LAG_S + PERIOD_S
"""Delay from a command to the picture [s]: servo and tip, and one control period."""


@dataclass(frozen=True, kw_only=True)
class RepetitiveSettings:
    """Period, and rate of learning."""

    period_s: Annotated[float, bounded(0.02, 1e4, "s")]
    """Period of the target's motion [s], 0.02 to 1e4."""
    learning: Annotated[float, bounded(1e-6, 1)] = 0.5
    """Fraction g of the error that is corrected each period [1], 1e-6 to 1. Assumed."""
    points: Annotated[int, bounded(8, 4096)] = 96
    """Number of points of the table, 8 to 4096. Assumed: 0.1 s apart for strokes, 0.2 s for the
    circle."""
    target_distance_m: linear_process.Depth = 0.12
    """Depth of the target [m], 0.001 to 10. Source: 12 cm, thesis ch. 6."""
    bend_per_handle: linear_process.Slope = linear_process.BEND_PER_HANDLE
    """Slope of the transmission [rad/rad], 0.001 to 100. Assumed."""

    def __post_init__(self) -> None:
        settle(self, "repetitive")


@dataclass
class RepetitiveMemory:
    """State of the controller."""

    up_down: list[float] = field(default_factory=list)
    """Table of up_down angles over the phase [rad]."""
    left_right: list[float] = field(default_factory=list)
    """Table of left_right angles over the phase [rad]."""
    seen_s: float | None = None
    """Exposure time of the newest frame [s]."""


class Repetitive:
    """Replays and corrects a table.

    Args:
        calibration: turns pixels into angles.
        settings: period and learning.
        geometry: lengths of the section; the defaults if None.
    """

    def __init__(
        self,
        calibration: Calibration,
        settings: RepetitiveSettings,
        geometry: SectionGeometry | None = None,
    ) -> None:
        self._calibration, self._settings = calibration, settings
        distance, slope = settings.target_distance_m, settings.bend_per_handle
        self._gain = linear_process.image_gain(geometry or SectionGeometry(), distance, slope)
        self.memory = RepetitiveMemory()
        self._fill((0.0, 0.0))

    def reset(self, state: State) -> None:
        """Fill the table with the present goals of the handles."""
        self.memory = RepetitiveMemory()
        self._fill((state.goal[0], state.goal[1]))

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Correct the table with each frame that shows the target, and replay it.

        See `Controller.update`; an axis at its limit learns only away from it.
        """
        if observation is not None:
            if observation.status is Status.TRACKING:
                self._learn(observation.t_capture, error(self._calibration, observation), state)
            self.memory.seen_s = observation.t_capture
        n, share = self._phase(t)
        tables = (self.memory.up_down, self.memory.left_right)
        up_down, left_right = (
            (1 - share) * table[n] + share * table[(n + 1) % len(table)] for table in tables
        )
        return Command(position=(up_down, left_right))

    def _fill(self, handles: Pair) -> None:
        count = self._settings.points
        self.memory.up_down, self.memory.left_right = ([h] * count for h in handles)

    def _phase(self, t: float) -> tuple[int, float]:
        """Index of the table at or before a time, and the fraction to the next index."""
        count = self._settings.points
        phase = t / self._settings.period_s % 1.0 * count
        n = min(int(phase), count - 1)
        return n, phase - n

    def _learn(self, t: float, errors: Pair, state: State) -> None:
        settings, before = self._settings, self.memory.seen_s
        since = 0.0 if before is None else min(max(t - before, 0.0), 0.2)
        # Each point is corrected once per period, at any frame rate.
        step = (
            settings.learning / self._gain * min(1.0, since * settings.points / settings.period_s)
        )
        n, share = self._phase(t - LEAD_S)
        tables = (self.memory.up_down, self.memory.left_right)
        for table, e, clipped in zip(tables, errors, state.clipped, strict=True):
            if clipped * e > 0:
                continue
            table[n] += step * (1 - share) * e
            table[(n + 1) % len(table)] += step * share * e
