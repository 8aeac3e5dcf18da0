"""Measured places of the target over the last half minute, at uneven times."""

from __future__ import annotations

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
        self._begin = self._end = 0
        self.since_s = 0.0
        """Time since which there was no gap [s]."""

    @property
    def times(self) -> Vector:
        """Exposure times [s], increasing."""
        return self._times[self._begin : self._end]

    @property
    def places(self) -> Vector:
        """Places, one row per axis [rad]."""
        return self._places[:, self._begin : self._end]

    def add(self, t: float, place: Pair) -> None:
        """Add a place that is newer than all others."""
        if self._begin == self._end or t - self._times[self._end - 1] > GAP_S:
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
        while self._times[self._begin] < t - WINDOW_S:
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
        known, places = self.times, self.places
        n = int(np.searchsorted(known, t))
        if n == 0 or n == len(known):
            n = min(n, len(known) - 1)
            return float(places[0, n]), float(places[1, n]), 1.0
        before = float(known[n - 1])
        part = (t - before) / (float(known[n]) - before)
        (a, c), (b, d) = places[:, n - 1].tolist(), places[:, n].tolist()
        return a + part * (b - a), c + part * (d - c), (1 - part) ** 2 + part**2

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
