"""Counts reversals of the commanded handle angles: too many make the lock cautious."""

from __future__ import annotations

from dataclasses import dataclass, field

from endolock.control.transmission.kinematics import Pair

WINDOW_S = 2.0
"""Time over which reversals are counted [s]. Assumed."""


@dataclass
class Reversals:
    """Reversals of both handles."""

    extremes: Pair = (0.0, 0.0)
    """Farthest goals since the last reversals [rad]."""
    directions: Pair = (0.0, 0.0)
    """Directions of motion, +1 or -1; 0 at first."""
    times: list[float] = field(default_factory=list)
    """Times of the reversals within the last `WINDOW_S` [s]."""
    total: int = 0
    """Number of reversals since the start."""
    cautious: bool = False
    """Whether there are too many."""

    def update(self, t: float, goals: Pair, *, swing_rad: float, busy_per_s: float) -> None:
        """Take the goals of one tick.

        Args:
            t: time of the tick [s].
            goals: commanded handle angles [rad].
            swing_rad: motion back from the extreme that counts as a reversal [rad].
            busy_per_s: reversals per second above which the lock becomes cautious; it remains so
                above half of it [1/s].
        """
        extremes, directions = [], []
        for goal, extreme, direction in zip(goals, self.extremes, self.directions, strict=True):
            moved = goal - extreme
            if direction * moved >= 0 and (direction or abs(moved) < swing_rad):
                extreme = goal if direction else extreme
            elif abs(moved) >= swing_rad:
                if direction:
                    self.times.append(t)
                    self.total += 1
                extreme, direction = goal, 1.0 if moved > 0 else -1.0
            extremes.append(extreme)
            directions.append(direction)
        self.extremes, self.directions = (
            (extremes[0], extremes[1]),
            (directions[0], directions[1]),
        )
        self.times = [time for time in self.times if time > t - WINDOW_S]
        limit = WINDOW_S * busy_per_s
        self.cautious = len(self.times) > (limit / 2 if self.cautious else limit)
