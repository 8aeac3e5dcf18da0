"""The capstan model of both axes while the lock runs: searched for in slices, then followed.

The search (control/predictive/online_capstan.py) works on a window of the past. Its result is
simulated up to the present, a few ticks per tick, and then replaces the model that is followed.
States on the way are stored, so that the next window starts exactly. After a change of the
transmission windows start there.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, sin

import numpy as np

from endolock.control.predictive import online_capstan
from endolock.control.predictive.capstan_rollout import CapstanRollout
from endolock.control.predictive.handle_history import ROOM, HandleHistory
from endolock.control.predictive.online_capstan import Search, Stored
from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Vector

WINDOW_S = 25.0
"""Length of the window [s]."""
LEAD_S = 3.0
"""Start of a window that is not used, as the state there is unknown [s]."""
MIN_FRAMES = 100
"""Smallest number of frames in a window."""
MIN_FRAMES_SINCE = 35
"""The same after a change [1]. Assumed."""
CATCH_UP = 12
"""Ticks per tick at which a model found on an older window catches up."""
KEEP_S = 1.0
"""Time between stored states [s]."""
RELEARN_S, SHORT_S = 15.0, 8.0
"""Time after a change for which the search does not slow down, and length of the window then [s].
Assumed: three turns of the target, and less than two."""
NUDGE_RAD = 1e-3
"""Change of the bend with which the width of a loop is found [rad]."""
STEPS, LONG_S = 3, 6.0
"""Number of steps of the search, and length of the last window, before it is used [1, s].
Assumed."""


@dataclass
class CapstanModel:
    """Search, the model that is followed, and its bends at the newest ticks."""

    search: Search = field(default_factory=Search)
    """Search for the parameters."""
    followed: CapstanRollout | None = None
    """The model that follows the handles."""
    fitted_s: float = 0.0
    """End of the window from which it was found [s]."""
    _quick: bool = False
    _since_s: float | None = None  # of the last change of the transmission
    _bends: Vector = field(default_factory=lambda: np.zeros((ROOM, 2)))
    _count: int = 0
    _catching_up: CapstanRollout | None = None
    _caught_up_s: float = 0.0
    _kept: list[Stored] = field(default_factory=list)
    _found: list[Stored] = field(default_factory=list)

    @property
    def bends(self) -> Vector:
        """Bends of the followed model at the newest ticks, n x 2 [rad]."""
        return self._bends[: self._count]

    @property
    def idle(self) -> bool:
        """Whether the next call of `work` needs frames."""
        return self._catching_up is None and self.search.window is None

    def ready(self, history: HandleHistory) -> bool:
        """Whether the search has gone far enough for the model to be used."""
        count = min(self._count, len(history.times))
        if self._quick:
            return count > 1 and self.search.steps > 0
        enough = count > 1 and self.search.steps >= STEPS
        return enough and history.times[-1] - history.times[-count] > LONG_S

    def follow(self, history: HandleHistory) -> None:
        """Simulate the newest tick."""
        if self.followed is None:
            return
        t, (up_down, left_right) = float(history.times[-1]), history.angles[-1].tolist()
        self.followed.bends = []
        self.followed.follow([(up_down, left_right)])
        self._keep(self.followed.bends)
        if t - self._kept[-1][0] > KEEP_S:
            self._kept.append((t, self.followed.states))
            self._kept = [kept for kept in self._kept if kept[0] > t - WINDOW_S - LEAD_S]

    def bends_at(self, history: HandleHistory, t: Vector) -> Vector:
        """Bends at times within `bends`, between ticks by linear interpolation, n x 2 [rad]."""
        count = min(self._count, len(history.times))
        times, bends = history.times[-count:], self.bends[-count:]
        return np.column_stack([np.interp(t, times, column) for column in bends.T])

    def handles_for(self, bend: Pair, handles: Pair) -> Pair:
        """Handle angles that give a bend from the present state [rad]."""
        assert self.followed is not None
        present, gain = self.bends[-1].tolist(), self.followed.parameters.handle_gain
        up_down, left_right = self.followed.axes
        return (
            up_down.handle_for(bend[0], gain * handles[1], present[1]) / gain,
            left_right.handle_for(bend[1], gain * handles[0], present[0]) / gain,
        )

    def widths(self, handles: Pair) -> Pair:
        """Way of each handle between two bends that differ by `2 NUDGE_RAD` at present [rad]."""
        up_down, left_right = self.bends[-1].tolist()
        above = self.handles_for((up_down + NUDGE_RAD, left_right + NUDGE_RAD), handles)
        below = self.handles_for((up_down - NUDGE_RAD, left_right - NUDGE_RAD), handles)
        return above[0] - below[0], above[1] - below[1]

    def work(self, history: HandleHistory, frames: Vector, knot_s: float) -> bool:
        """Continue the search by one slice; return whether the followed model was replaced.

        Args:
            history: handle angles at the ticks.
            frames: believed exposure times and what the bends are to be added to for a slow path,
                n x 3 [s, rad, rad].
            knot_s: spacing of the knots of that path [s].
        """
        if self._catching_up:
            return self._catch_up(self._catching_up, history)
        if self.search.window is None:
            self._open_window(history, frames, knot_s)
            return False
        window = self.search.window
        if self._since_s is not None and history.times[-1] < self._since_s + RELEARN_S:
            self.search.settled = False
        found = online_capstan.work(self.search)
        if found is not None:
            bends = window.bends(found, np.array(window.ticks))
            past = [(float(up_down), float(left_right)) for up_down, left_right in bends]
            self._catching_up = CapstanRollout(found.parameters, found.states, past)
            self.fitted_s = self._caught_up_s = window.ticks[-1]
            self._found = window.stored
        return False

    def changed(self, t: float, *, measured: bool) -> None:
        """Search anew from what is found, on frames from a time on.

        Args:
            t: when the transmission changed [s].
            measured: whether bends are: then a turn of the target is enough, with a prior that
                lets little else than friction change.
        """
        found = self.search.parameters
        if self.search.steps or not measured:
            self.search = online_capstan.after_change(found) if measured else Search(found)
        self._catching_up = None
        self._since_s, self._quick = t, measured

    def _keep(self, bends: list[Pair]) -> None:
        """Append bends of the newest ticks; the oldest are dropped when there is no room."""
        if self._count + len(bends) > ROOM:
            kept = self._bends[self._count - ROOM // 2 : self._count].copy()
            self._bends[: ROOM // 2], self._count = kept, ROOM // 2
        self._bends[self._count : self._count + len(bends)] = bends
        self._count += len(bends)

    def _open_window(self, history: HandleHistory, frames: Vector, knot_s: float) -> None:
        times = history.times
        start, states = self._kept[0] if self._kept else (float(times[0]) - 1e-9, ([], []))
        now = float(times[-1])
        since, least = max(start + LEAD_S, now - WINDOW_S), MIN_FRAMES
        if self._since_s is not None and self._since_s > since:
            since, least = self._since_s, MIN_FRAMES_SINCE if self._quick else MIN_FRAMES
            if self._quick and now < self._since_s + RELEARN_S:
                since = max(since, now - SHORT_S)
            start, states = max(
                (kept for kept in self._kept if kept[0] <= since), default=(start, states)
            )
        rows = frames[frames[:, 0] > since]
        if len(rows) < least:
            return
        first = int(np.searchsorted(times, start, side="right"))
        seen = [(float(t), float(a), float(b)) for t, a, b in rows]
        online_capstan.begin(
            self.search, times[first:], history.angles[first:], seen, states, knot_s
        )

    def _catch_up(self, capstan: CapstanRollout, history: HandleHistory) -> bool:
        """Simulate the found model up to the present, where it replaces the old one."""
        times = history.times
        first = int(np.searchsorted(times, self._caught_up_s, side="right"))
        last = min(first + CATCH_UP, len(times))
        capstan.follow([(a, b) for a, b in history.angles[first:last].tolist()])
        self._caught_up_s = float(times[last - 1])
        if last < len(times):
            return False
        self.followed = CapstanRollout(capstan.parameters, capstan.states)
        since = self._found[0][0] if self._found else np.inf
        self._kept = [kept for kept in self._kept if kept[0] < since] + self._found
        self._catching_up = None
        self._count = 0
        self._keep(capstan.bends[-min(len(times), ROOM // 2) :])
        return True


def rotation(angle: float) -> Vector:
    """Rotation from axes of the video to those of the wires, by their angle [rad], 2 x 2."""
    return np.array([[cos(angle), -sin(angle)], [sin(angle), cos(angle)]])
