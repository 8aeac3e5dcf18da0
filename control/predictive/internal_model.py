"""Model of the transmission inside the lock: plays at first, a capstan model once one fits.

Both follow the measured handles. The weights of the plays are identified every two seconds, a
convex problem that needs no starting point (control/predictive/online_plays.py). The capstan model
has few parameters, each of which affects all loops, and is searched for in a slice per tick
(control/predictive/online_capstan.py). It is used while its residual is clearly below that of the
plays.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, sin

import numpy as np

from endolock.control.predictive import online_capstan, online_plays
from endolock.control.predictive.axis_plays import PRIOR, RADII, AxisPlays
from endolock.control.predictive.capstan_rollout import CapstanRollout, axes_of
from endolock.control.predictive.online_capstan import Search
from endolock.control.predictive.online_plays import WINDOW_S
from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import State, Vector

MIN_FRAMES = 100
"""Smallest number of frames for identification."""
SETTLED_S = 0.2
"""Frames exposed earlier than this after the first tick are not used, whatever the latency [s]."""
RENEWAL = 0.3
"""Fraction of the step from the old to the identified latency. Assumed."""
LEAD_S = 3.0
"""Start of a window that is not used for the capstan, whose state there is unknown [s]."""
BETTER, WORSE = 1.2, 2.5
"""Ratios of the capstan's residual to that of the plays up to which it is adopted, and above which
it is dropped: with half as many parameters its residual may be a little larger. Source: tuned on
the default instrument, as are `SMALL_RAD` and `LARGE_RAD`."""
SMALL_RAD, LARGE_RAD = 0.01, 0.02
"""With a smaller residual the capstan is never dropped, and with a larger one never adopted: where
the target moves too fast for the splines, the residual does not discriminate [rad]."""
STEPS, LONG_S = 3, 18.0
"""Number of steps, and length of the window of the last one, needed for adoption [1, s].
Assumed."""
CATCH_UP = 12
"""Ticks per tick at which a capstan identified on an older window catches up."""
KEEP_S = 1.0
"""Time between stored states [s]."""


@dataclass
class InternalModel:
    """Both models, the history of the handles, and which model is used."""

    axes: tuple[AxisPlays, AxisPlays] = field(default_factory=lambda: (AxisPlays(), AxisPlays()))
    """Plays of up_down and left_right."""
    times: list[float] = field(default_factory=list)
    """Times of the measured handle states [s]."""
    handles: list[Pair] = field(default_factory=list)
    """Handle angles at these times [rad]."""
    plays: list[list[list[float]]] = field(default_factory=list)
    """Outputs of all plays at these times, by axis [rad]."""
    shift_s: float = 0.0
    """Delay of the exposures relative to their believed times, by the plays [s]."""
    shift_std_s: float = 0.0
    """Standard deviation of that delay [s]."""
    misfit_rad: float = 0.0
    """Residual of the plays, rms [rad]."""
    search: Search = field(default_factory=Search)
    """Search for the capstan's parameters."""
    capstan: CapstanRollout | None = None
    """The capstan that follows the handles."""
    catching_up: CapstanRollout | None = None
    """A capstan identified on an older window, not yet simulated up to the present."""
    caught_up_s: float = 0.0
    """Time up to which it is simulated [s]."""
    bends: list[Pair] = field(default_factory=list)
    """Bends of the capstan at the newest times [rad]."""
    kept: list[tuple[float, tuple[list[float], list[float]]]] = field(default_factory=list)
    """Times and past states of the capstan."""
    capstan_used: bool = False
    """Whether the capstan is used instead of the plays."""

    @property
    def since(self) -> float:
        """Time from which the bends are known [s]."""
        return self.times[-len(self.bends)] if self.capstan_used else self.times[0] + SETTLED_S

    @property
    def shift(self) -> float:
        """Delay of the exposures relative to their believed times [s]."""
        return self.search.parameters.shift_s if self.capstan_used else self.shift_s

    @property
    def bend(self) -> Pair:
        """Present bend [rad]."""
        if self.capstan_used:
            return self.bends[-1]
        up_down, left_right = (axis.model.bend_rad for axis in self.axes)
        return up_down, left_right

    def rotated(self, offset: Pair) -> Pair:
        """Rotate an offset in the video to the axes of the bends [rad]."""
        angle = self.search.parameters.video_turn_rad if self.capstan_used else 0.0
        c, s = cos(angle), sin(angle)
        return c * offset[0] - s * offset[1], s * offset[0] + c * offset[1]

    def follow(self, state: State) -> None:
        """Run both models on the measured handles."""
        if self.times and state.t <= self.times[-1]:
            return
        handles = state.position[0], state.position[1]
        outputs = []
        for axis, handle in zip(self.axes, handles, strict=True):
            axis.model.follow(handle)
            outputs.append(list(axis.outputs))
        self.times.append(state.t)
        self.handles.append(handles)
        self.plays.append(outputs)
        if self.capstan:
            self.capstan.bends = []
            self.capstan.follow([handles])
            self.bends += self.capstan.bends
            if state.t - self.kept[-1][0] > KEEP_S:
                self.kept.append((state.t, self.capstan.states))
                self.kept = [kept for kept in self.kept if kept[0] > state.t - WINDOW_S - LEAD_S]
        if self.times[0] < state.t - WINDOW_S - LEAD_S - 1.0:
            del self.times[:50], self.handles[:50], self.plays[:50]
            self.bends = self.bends[-len(self.times) :]

    def bend_at(self, t: float) -> Pair:
        """Bend at a past time [rad]."""
        known = self.bends if self.capstan_used else self.plays
        times = self.times[-len(known) :]
        n = int(np.clip(np.searchsorted(times, t), 1, max(len(times) - 1, 1)))
        last = min(n, len(times) - 1)
        step = times[last] - times[n - 1]
        share = min(max((t - times[n - 1]) / step, 0.0), 1.0) if step else 0.0
        if self.capstan_used:
            before, after = self.bends[n - 1], self.bends[last]
        else:
            before, after = self._by_plays(n - 1), self._by_plays(last)
        up_down, left_right = (a + share * (b - a) for a, b in zip(before, after, strict=True))
        return up_down, left_right

    def bends_at(self, t: Vector) -> Vector:
        """Bends at many past times, n x 2 [rad]."""
        if self.capstan_used:
            times = self.times[-len(self.bends) :]
            return np.column_stack(
                [np.interp(t, times, column) for column in np.array(self.bends).T]
            )
        plays = np.array(self.plays)
        return np.column_stack(
            [
                np.interp(t, self.times, plays[:, n] @ np.array(axis.weights))
                for n, axis in enumerate(self.axes)
            ]
        )

    def handles_for(self, bend: Pair) -> Pair:
        """Handle angles that give a bend [rad]."""
        if not self.capstan_used or self.capstan is None:
            angles = (a.model.handle_for(b) for a, b in zip(self.axes, bend, strict=True))
            return next(angles), next(angles)
        handle, present = self.handles[-1], self.bends[-1]
        up_down, left_right = axes_of(self.capstan.parameters, self.capstan.states)
        return (
            up_down.handle_for(bend[0], handle[1], present[1]),
            left_right.handle_for(bend[1], handle[0], present[0]),
        )

    def identify(self, seen: Vector, damping: float) -> bool:
        """Identify the weights of the plays and the latency; return whether that was possible.

        Args:
            seen: believed exposure times and offsets of the target, n x 3 [s, rad, rad].
            damping: fraction of the step from the old to the identified weights.
        """
        seen = seen[seen[:, 0] > self.times[0] + SETTLED_S]
        if len(seen) < MIN_FRAMES:
            return False
        found = online_plays.identify(
            seen[:, 0],
            seen[:, 1:],
            np.array(self.times),
            np.array(self.plays),
            np.array(PRIOR),
            np.array(RADII),
            self.shift_s,
        )
        if found is None:
            return False
        self.shift_s += RENEWAL * (found.shift_s - self.shift_s)
        self.shift_std_s, self.misfit_rad = found.shift_std_s, found.misfit_rad
        for axis, weights, std in zip(self.axes, found.weights, found.width_std, strict=True):
            if weights is not None:
                old = np.array(axis.weights)
                axis.weights = (old + damping * (weights - old)).tolist()
                axis.width_std = std
        return True

    def look_for_capstan(self, seen: list[tuple[float, float, float]]) -> bool:
        """Continue the search by one slice; return whether the model in use changed."""
        if self.catching_up:
            return self._catch_up(self.catching_up)
        if self.search.window is None:
            self._open_window(seen)
            return False
        window = self.search.window
        found = online_capstan.work(self.search)
        if found is not None:
            bends = window.bends(found, np.array(window.ticks))
            past = [(float(up_down), float(left_right)) for up_down, left_right in bends]
            self.catching_up = CapstanRollout(found.parameters, found.states, past)
            self.caught_up_s = window.ticks[-1]
            self.kept = self.kept or [(window.ticks[0], window.states)]
        return self.search.window is None and found is None and self._choose()

    def _open_window(self, seen: list[tuple[float, float, float]]) -> None:
        start, states = self.kept[0] if self.kept else (self.times[0] - 1e-9, ([], []))
        frames = [frame for frame in seen if frame[0] > start + LEAD_S]
        if len(frames) < MIN_FRAMES:
            return
        first = int(np.searchsorted(self.times, start, side="right"))
        times, handles = np.array(self.times[first:]), np.array(self.handles[first:])
        online_capstan.begin(self.search, times, handles, frames, states)

    def _catch_up(self, capstan: CapstanRollout) -> bool:
        """Simulate the identified model up to the present, where it replaces the old one."""
        first = int(np.searchsorted(self.times, self.caught_up_s, side="right"))
        last = min(first + CATCH_UP, len(self.times))
        capstan.follow(self.handles[first:last])
        self.caught_up_s = self.times[last - 1]
        if last < len(self.times):
            return False
        self.capstan = CapstanRollout(capstan.parameters, capstan.states)
        self.catching_up = None
        self.bends = capstan.bends[-len(self.times) :]
        self._choose()
        return self.capstan_used

    def _choose(self) -> bool:
        """Select the capstan or the plays; return whether the selection changed."""
        limit = max(WORSE * self.misfit_rad, SMALL_RAD)
        if not self.capstan_used:
            limit = min(BETTER * self.misfit_rad, LARGE_RAD)
        ready = len(self.bends) > 0 and self.search.steps >= STEPS
        long = ready and self.times[-1] - self.times[-len(self.bends)] > LONG_S
        before, self.capstan_used = self.capstan_used, long and self.search.misfit_rad < limit
        return self.capstan_used is not before

    def _by_plays(self, n: int) -> Pair:
        up_down, left_right = (
            sum(w * z for w, z in zip(axis.weights, outputs, strict=True))
            for axis, outputs in zip(self.axes, self.plays[n], strict=True)
        )
        return up_down, left_right


def at_rest(handles: Pair) -> InternalModel:
    """Return both models at rest at handle angles [rad], with the plays centred on them."""
    up_down, left_right = (AxisPlays(outputs=[h] * len(RADII)) for h in handles)
    return InternalModel(axes=(up_down, left_right))
