"""What a lock believes of the transmission: plays from the start, a capstan once one fits.

Both follow the measured handles. The plays' weights are found anew every two seconds, which is a
convex problem and works from nothing (control/predictive/online_plays.py). The capstan model has
few parameters, each of which shapes all loops, and is searched for a slice per tick
(control/predictive/online_capstan.py); it is believed while it leaves clearly less than the plays
do.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, pi, sin

import numpy as np

from endolock.control.predictive import online_capstan, online_plays
from endolock.control.predictive.online_capstan import Search, Track
from endolock.control.predictive.online_plays import WINDOW_S
from endolock.control.transmission.kinematics import Pair
from endolock.control.transmission.linear_process import BEND_PER_HANDLE
from endolock.control.transmission.plays import Hysteresis, Plays
from endolock.hw.api import State, Vector

RADII = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7)
"""Half-widths of the plays [rad]: loops of up to 0.45 of 180 deg."""
PRIOR = (BEND_PER_HANDLE, *[0.0] * (len(RADII) - 1))
"""Weights at the start: no hysteresis. Over-compensation is what loses targets."""
MIN_FRAMES = 100
"""Fewer identify nothing."""
SETTLED_S = 0.2
"""Frames from before the first tick cannot be used, whatever the latency comes to [s]."""
RENEWAL = 0.3
"""Share of the way from the old to the identified latency. Assumed."""
LEAD_S = 3.0
"""A window's first frames tell nothing of a capstan: its past is guessed."""
BETTER, WORSE = 1.2, 2.5
"""The capstan is believed once it leaves no more than so many times what the plays leave, and until
it leaves so many times as much: with half their parameters it may leave a little more.
Source: tuned on the default instrument, like what follows."""
SMALL_RAD, LARGE_RAD = 0.01, 0.02
"""What leaves less is never given up, and what leaves more is not begun with: where the target
moves too quickly for the splines, nothing can be told [rad]."""
STEPS, LONG_S = 3, 18.0
"""So many steps, the last on so long a window, are needed before that [1, s]. Assumed."""
CATCH_UP = 12
"""Ticks followed in one, by a capstan that was found on an older window."""
KEEP_S = 1.0
"""States are kept so far apart [s]."""


@dataclass
class AxisPlays:
    """Plays of one axis."""

    weights: list[float] = field(default_factory=lambda: list(PRIOR))
    places: list[float] = field(default_factory=lambda: [0.0] * len(RADII))
    """[rad]"""
    width_std: float = pi
    """Standard deviation of the mean width of its loops [rad]."""

    @property
    def model(self) -> Hysteresis:
        """The model, which moves the places."""
        return Hysteresis(Plays(radii=RADII, weights=tuple(self.weights)), self.places)

    @property
    def width(self) -> float:
        """Mean full width of its loops [rad]."""
        wide = sum(w * r for w, r in zip(self.weights, RADII, strict=True))
        return 2 * wide / max(sum(self.weights), 1e-6)


@dataclass
class InternalModel:
    """Both models, the handles' past, and which one is believed."""

    axes: tuple[AxisPlays, AxisPlays] = field(default_factory=lambda: (AxisPlays(), AxisPlays()))
    times: list[float] = field(default_factory=list)
    handles: list[Pair] = field(default_factory=list)
    plays: list[list[list[float]]] = field(default_factory=list)
    """Places of all plays at those times, by axis [rad]."""
    shift_s: float = 0.0
    """Exposures were so much later than believed [s], by the plays."""
    shift_std_s: float = 0.0
    misfit_rad: float = 0.0
    """What the plays leave, rms [rad]."""
    search: Search = field(default_factory=Search)
    capstan: Track | None = None
    """The capstan that follows the handles."""
    coming: Track | None = None
    """One that was found on an older window and catches up."""
    reached: float = 0.0
    """The tick to which it has [s]."""
    bends: list[Pair] = field(default_factory=list)
    """Of the capstan at the newest times [rad]."""
    kept: list[tuple[float, tuple[list[float], list[float]]]] = field(default_factory=list)
    """Past states of the capstan, with their times."""
    believed: bool = False
    """Whether the capstan is."""

    @property
    def since(self) -> float:
        """The bends are known from then on [s]."""
        return self.times[-len(self.bends)] if self.believed else self.times[0] + SETTLED_S

    @property
    def shift(self) -> float:
        """Exposures were so much later than believed [s]."""
        return self.search.values.shift_s if self.believed else self.shift_s

    @property
    def bend(self) -> Pair:
        """Present bend [rad]."""
        if self.believed:
            return self.bends[-1]
        one, other = (axis.model.bend_rad for axis in self.axes)
        return one, other

    def turned(self, off: Pair) -> Pair:
        """Turn what the video shows back to the axes of the bends."""
        angle = self.search.values.video_turn_rad if self.believed else 0.0
        c, s = cos(angle), sin(angle)
        return c * off[0] - s * off[1], s * off[0] + c * off[1]

    def follow(self, state: State) -> None:
        """Run both models on the measured handles."""
        if self.times and state.t <= self.times[-1]:
            return
        handles = state.position[0], state.position[1]
        places = []
        for axis, handle in zip(self.axes, handles, strict=True):
            axis.model.follow(handle)
            places.append(list(axis.places))
        self.times.append(state.t)
        self.handles.append(handles)
        self.plays.append(places)
        if self.capstan:
            self.capstan.bends = []
            self.capstan.go_on([handles])
            self.bends += self.capstan.bends
            if state.t - self.kept[-1][0] > KEEP_S:
                self.kept.append((state.t, self.capstan.states))
                self.kept = [one for one in self.kept if one[0] > state.t - WINDOW_S - LEAD_S]
        if self.times[0] < state.t - WINDOW_S - LEAD_S - 1.0:
            del self.times[:50], self.handles[:50], self.plays[:50]
            self.bends = self.bends[-len(self.times) :]

    def bend_at(self, t: float) -> Pair:
        """Bend at a past time [rad]."""
        known = self.bends if self.believed else self.plays
        times = self.times[-len(known) :]
        n = int(np.clip(np.searchsorted(times, t), 1, max(len(times) - 1, 1)))
        last = min(n, len(times) - 1)
        step = times[last] - times[n - 1]
        share = min(max((t - times[n - 1]) / step, 0.0), 1.0) if step else 0.0
        if self.believed:
            before, after = self.bends[n - 1], self.bends[last]
        else:
            before, after = self._by_plays(n - 1), self._by_plays(last)
        one, other = (a + share * (b - a) for a, b in zip(before, after, strict=True))
        return one, other

    def course(self, moments: Vector) -> Vector:
        """Bends at many past times, n x 2 [rad]."""
        if self.believed:
            times = self.times[-len(self.bends) :]
            return np.column_stack(
                [np.interp(moments, times, column) for column in np.array(self.bends).T]
            )
        plays = np.array(self.plays)
        return np.column_stack(
            [
                np.interp(moments, self.times, plays[:, n] @ np.array(axis.weights))
                for n, axis in enumerate(self.axes)
            ]
        )

    def handles_for(self, bend: Pair) -> Pair:
        """Handle angles that would bring about bends [rad]."""
        if not self.believed or self.capstan is None:
            one, other = (a.model.handle_for(b) for a, b in zip(self.axes, bend, strict=True))
            return one, other
        (h1, h2), (b1, b2) = self.handles[-1], self.bends[-1]
        up_down, left_right = online_capstan.made(self.capstan.values, self.capstan.states)
        return up_down.handle_for(bend[0], h2, b2), left_right.handle_for(bend[1], h1, b1)

    def identify(self, seen: Vector, damping: float) -> bool:
        """Find the plays' weights and the latency anew; return whether that was possible.

        Args:
            seen: exposures as believed [s] and offsets of the target then, n x 3 [s, rad, rad].
            damping: share of the way from the old to the new weights.
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
        """Go on with the search for a slice; return whether what is believed changed."""
        if self.coming:
            return self._catch_up(self.coming)
        if self.search.window is None:
            self._open_window(seen)
            return False
        window = self.search.window
        found = online_capstan.work(self.search)
        if found is not None:
            bends = window.bends(found, np.array(window.ticks))
            course = [(float(one), float(other)) for one, other in bends]
            self.coming, self.reached = Track(found.values, found.states, course), window.ticks[-1]
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

    def _catch_up(self, coming: Track) -> bool:
        """Let the found model follow what has happened since; in the end it takes over."""
        first = int(np.searchsorted(self.times, self.reached, side="right"))
        last = min(first + CATCH_UP, len(self.times))
        coming.go_on(self.handles[first:last])
        self.reached = self.times[last - 1]
        if last < len(self.times):
            return False
        self.capstan, self.coming = Track(coming.values, coming.states), None
        self.bends = coming.bends[-len(self.times) :]
        self._choose()
        return self.believed

    def _choose(self) -> bool:
        """Believe the capstan or the plays; return whether that is new."""
        limit = max(WORSE * self.misfit_rad, SMALL_RAD)
        if not self.believed:
            limit = min(BETTER * self.misfit_rad, LARGE_RAD)
        ready = len(self.bends) > 0 and self.search.steps >= STEPS
        long = ready and self.times[-1] - self.times[-len(self.bends)] > LONG_S
        before, self.believed = self.believed, long and self.search.misfit_rad < limit
        return self.believed is not before

    def _by_plays(self, n: int) -> Pair:
        one, other = (
            sum(w * p for w, p in zip(axis.weights, places, strict=True))
            for axis, places in zip(self.axes, self.plays[n], strict=True)
        )
        return one, other


def started(handles: Pair) -> InternalModel:
    """Return the models at rest at handle angles, the plays centred on them."""
    one, other = (AxisPlays(places=[h] * len(RADII)) for h in handles)
    return InternalModel(axes=(one, other))
