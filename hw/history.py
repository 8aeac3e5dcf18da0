"""A memory of handle states that can be asked for any moment of the recent past."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import replace

from endolock.hw.api import State


class History:
    """States in the order of time, with linear interpolation in between.

    Args:
        span_s: how far back it reaches [s].
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
        """Return the state at time `t` [s]: the one before, its position and velocity interpolated.

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


def _mix(a: tuple[float, ...], b: tuple[float, ...], w: float) -> tuple[float, ...]:
    return tuple(x + w * (y - x) for x, y in zip(a, b, strict=True))
