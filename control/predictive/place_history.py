"""Measured places of the target over the last half minute, at uneven times."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence

import numpy as np

from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Vector

WINDOW_S = 30.0
"""Length of the past that is kept [s]. Assumed: three periods of slow strokes."""
CAPACITY = 4096
"""Number of places in memory [1]: the window at 60 frames per second, twice."""
GAP_S = 0.3
"""Time without a place after which the past counts as interrupted [s]. Assumed: seven frames."""


class PlaceHistory:
    """Places of the target on both axes, the newest last."""

    def __init__(self) -> None:
        self._times = np.empty(CAPACITY)
        self._places = np.empty((2, CAPACITY))
        # the same numbers for one at a time, which arrays are slow for
        self._one_time = self._times.data
        self._one_place = self._places[0].data, self._places[1].data
        self._begin = self._end = 0
        self.since_s = 0.0
        """Time since which there was no gap [s]."""

    @property
    def times(self) -> Vector:
        """Exposure times [s], increasing."""
        return self._times[self._begin : self._end]

    @property
    def first_s(self) -> float:
        """Time of the oldest place [s]."""
        return self._one_time[self._begin]

    @property
    def places(self) -> Vector:
        """Places, one row per axis [rad]."""
        return self._places[:, self._begin : self._end]

    def add(self, t: float, place: Pair) -> None:
        """Add a place that is newer than all others."""
        if self._begin == self._end or t - self._one_time[self._end - 1] > GAP_S:
            self.since_s = t
        if self._end == CAPACITY:
            # The older half may be dropped: the window is shorter.
            kept = min(self._end - self._begin, CAPACITY // 2)
            self._times[:kept] = self._times[self._end - kept :]
            self._places[:, :kept] = self._places[:, self._end - kept :]
            self._begin, self._end = 0, kept
        self._times[self._end] = t
        self._places[:, self._end] = place
        self._end += 1
        while self._one_time[self._begin] < t - WINDOW_S:
            self._begin += 1

    def at(self, times: Vector) -> Vector:
        """Interpolate linearly at any times, one row per axis [rad]; constant outside."""
        known = self.times
        found = np.empty((2, len(times)))
        for row, places in zip(found, self.places, strict=True):
            row[:] = np.interp(times, known, places)
        return found

    def one_at(self, t: float) -> tuple[float, float, float]:
        """Interpolate at one time: place on both axes [rad], and its variance, in that of one."""
        times, (up_down, left_right) = self._one_time, self._one_place
        n = bisect_left(times, t, self._begin, self._end)
        if n in (self._begin, self._end):
            n = min(n, self._end - 1)
            return up_down[n], left_right[n], 1.0
        part = (t - times[n - 1]) / (times[n] - times[n - 1])
        a, b, c, d = up_down[n - 1], up_down[n], left_right[n - 1], left_right[n]
        return a + part * (b - a), c + part * (d - c), (1 - part) ** 2 + part**2

    def mean_at(self, axis: int, times: Sequence[float]) -> float:
        """Mean of the interpolated places of one axis at some times, in increasing order [rad]."""
        known, places = self._one_time, self._one_place[axis]
        n, total = bisect_left(known, times[0], self._begin, self._end), 0.0
        for t in times:
            while n < self._end and known[n] < t:
                n += 1
            if n in (self._begin, self._end):
                total += places[min(n, self._end - 1)]
            else:
                before, there = known[n - 1], places[n - 1]
                total += there + (t - before) / (known[n] - before) * (places[n] - there)
        return total / len(times)

    def move(self, by: Pair) -> None:
        """Add a constant to all places."""
        self.places[...] += np.array(by)[:, None]

    def replace(self, times: Vector, places: Vector) -> None:
        """Replace all places.

        Args:
            times: exposure times [s], increasing.
            places: one row per axis [rad].
        """
        times, places = times[-CAPACITY // 2 :], places[:, -CAPACITY // 2 :]
        self._begin, self._end = 0, len(times)
        self._times[: self._end], self._places[:, : self._end] = times, places
        gaps = np.flatnonzero(np.diff(times) > GAP_S)
        if len(times):
            self.since_s = float(times[gaps[-1] + 1 if len(gaps) else 0])
