"""Handle states of the recent past, interpolated in time."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field, replace

from endolock.hw.api import State

KEPT_S = 2.5
"""An `AngleHistory` reaches this far back [s]: more than any latency here."""


class History:
    """States in order of time, with linear interpolation in between.

    Args:
        span_s: how far back it reaches at least [s].
    """

    def __init__(self, span_s: float = 10.0) -> None:
        self._span_s = span_s
        self._times: list[float] = []
        self._states: list[State] = []

    def append(self, state: State) -> None:
        """Add the newest state; one measured no later than the last replaces it."""
        if self._times and state.t <= self._times[-1]:
            self._states[-1] = replace(state, t=self._times[-1])
            return
        self._times.append(state.t)
        self._states.append(state)
        # Trim seldom: cutting a list's head costs its length.
        if self._times[0] < state.t - 2 * self._span_s:
            old = bisect_right(self._times, state.t - self._span_s) - 1
            del self._times[:old], self._states[:old]

    def at(self, t: float) -> State:
        """Return the state at time `t` [s].

        Position and velocity are interpolated; all else is that of the state before `t`.

        Raises:
            LookupError: `t` lies before the first or after the last state.
        """
        if not self._times or not self._times[0] <= t <= self._times[-1]:
            known = f"{self._times[0]:.3f}..{self._times[-1]:.3f} s" if self._times else "nothing"
            raise LookupError(f"no handle state at t = {t:.3f} s; remembered is {known}")
        i = bisect_right(self._times, t) - 1
        before = self._states[i]
        if before.t == t:
            return before
        after = self._states[i + 1]
        w = (t - before.t) / (after.t - before.t)
        return replace(
            before,
            t=t,
            position=_mix(before.position, after.position, w),
            velocity=_mix(before.velocity, after.velocity, w),
        )


@dataclass
class AngleHistory:
    """Handle angles of the last `KEPT_S`: plain numbers, so that who keeps them can be saved."""

    times: list[float] = field(default_factory=list)
    """[s], rising."""
    angles: list[tuple[float, float]] = field(default_factory=list)
    """(up_down, left_right) at these times [rad]."""

    def append(self, state: State) -> None:
        """Add the newest state; one that is no newer than the last is ignored."""
        if self.times and state.t <= self.times[-1]:
            return
        self.times.append(state.t)
        self.angles.append((state.position[0], state.position[1]))
        while self.times[0] < state.t - KEPT_S:
            del self.times[0], self.angles[0]

    def at(self, t: float) -> tuple[float, float]:
        """Return the handle angles at time `t` [rad], interpolated; at least one is needed.

        Before the first and after the last time they are taken to be constant.
        """
        n = bisect_right(self.times, t)
        if n == 0 or n == len(self.times):
            up_down, left_right = self.angles[0 if n == 0 else -1]
            return up_down, left_right
        w = (t - self.times[n - 1]) / (self.times[n] - self.times[n - 1])
        up_down, left_right = _mix(self.angles[n - 1], self.angles[n], w)
        return up_down, left_right


def _mix(a: tuple[float, ...], b: tuple[float, ...], w: float) -> tuple[float, ...]:
    return tuple(x + w * (y - x) for x, y in zip(a, b, strict=True))
