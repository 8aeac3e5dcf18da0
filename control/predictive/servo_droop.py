"""Steady error of a servo without integral action, and its correction.

Under load such a servo stops short of its goal, by an amount that depends on the direction of
motion, since friction loads it: two numbers, learnt from the encoder while the handle follows
steadily, and blended over a small motion after each turn.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import exp

from endolock.control.transmission.linear_process import LAG_S
from endolock.control.transmission.plays import play_step

STEADY_RAD_S = 0.7
"""Speed up to which a handle follows its goal steadily [rad/s]. Assumed."""
LARGEST_RAD, RENEWAL_S = 0.02, 1.0
"""Largest droop [rad], and time constant with which it is learnt [s]. Assumed: 8 mrad are measured
on the twin."""
TURN_RAD = 0.01
"""Half the motion after a turn over which one droop replaces the other [rad]. Assumed."""
CLEAR = 0.9
"""Part of that motion after which a direction is clear [1]."""


@dataclass
class ServoDroop:
    """Droop of one handle."""

    droops: list[float] = field(default_factory=lambda: [0.0, 0.0])
    """While the goal falls, and while it rises [rad]."""
    follower: float | None = None
    """Output of a play of the goal, which shows its direction [rad]."""
    expected: float | None = None
    """Where a servo without droop would be [rad]."""

    def measure(self, goal: float, position: float, rate: float, dt: float) -> None:
        """Learn from one measurement.

        Args:
            goal: goal in force since the last one, without correction [rad].
            position: measured angle [rad].
            rate: measured speed [rad/s].
            dt: time since the last one [s].
        """
        before = position if self.expected is None else self.expected
        self.expected = goal + exp(-dt / LAG_S) * (before - goal)
        direction = self._direction(goal)
        if abs(direction) < CLEAR or abs(rate) > STEADY_RAD_S:
            return
        n = int(direction > 0)
        droop = self.droops[n] + dt / RENEWAL_S * (self.expected - position)
        self.droops[n] = min(max(droop, -LARGEST_RAD), LARGEST_RAD)

    def corrected(self, goal: float) -> float:
        """Return the goal to be sent, so that the handle arrives at the given one [rad]."""
        follower = goal if self.follower is None else self.follower
        self.follower = play_step(follower, goal, TURN_RAD)
        rising = (1 + self._direction(goal)) / 2
        return goal + (1 - rising) * self.droops[0] + rising * self.droops[1]

    def _direction(self, goal: float) -> float:
        """Direction of the goal: -1 falling to 1 rising."""
        return 0.0 if self.follower is None else (goal - self.follower) / TURN_RAD
