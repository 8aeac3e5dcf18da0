"""Handle angles of the last seconds, by time: what frames must be related to."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field

from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import State

KEPT_S = 2.5
"""So long is remembered [s]: more than any latency here."""


@dataclass
class Past:
    """Measured handle angles with their times; plain numbers, to be kept in a law's memory."""

    times: list[float] = field(default_factory=list)
    """[s], rising."""
    handles: list[Pair] = field(default_factory=list)
    """(up_down, left_right) then [rad]."""

    def add(self, state: State) -> None:
        """Take in the newest state; one that is no newer is left out."""
        if self.times and state.t <= self.times[-1]:
            return
        self.times.append(state.t)
        self.handles.append((state.position[0], state.position[1]))
        while self.times[0] < state.t - KEPT_S:
            del self.times[0], self.handles[0]

    def at(self, t: float) -> Pair:
        """Handle angles at a time [rad], on a straight line between samples.

        Before the first sample the handles are taken to have stood where they were then, after the
        last one where they are.
        """
        n = bisect_right(self.times, t)
        if n == 0 or n == len(self.times):
            return self.handles[0 if n == 0 else -1]
        share = (t - self.times[n - 1]) / (self.times[n] - self.times[n - 1])
        (a, b), (c, d) = self.handles[n - 1 : n + 1]
        return a + share * (c - a), b + share * (d - b)
