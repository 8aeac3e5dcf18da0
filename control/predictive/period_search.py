"""Periodic motion of the target: a period per axis with overtones, searched for in slices.

A round takes the places of the last half minute, fits every candidate period by weighted least
squares, a few per tick, refines the best few of each axis together with their period (Gauss-Newton)
and publishes, of those that fit equally well, the shortest: the multiples of a period fit as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, pi, sin

import numpy as np

from endolock.control.predictive.harmonic_fit import OVERTONES, Sample, refined, residuals_of
from endolock.control.predictive.place_history import WINDOW_S, PlaceHistory
from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Vector

PERIODS_S = np.concatenate(
    [1 / np.arange(1.42, 0.30, -0.012), np.geomspace(1 / 0.30, WINDOW_S, 56)]
)
"""Candidate periods [s], short ones first: heartbeat to a slow circle. Neighbours differ by a
quarter of a cycle over the window, or by 4 %."""
LEAST_S = 4.0
"""Shortest past that is fitted [s]."""
CYCLES = 1.15
"""Number of periods that the past must hold [1]. Assumed: a little more than one."""
AS_GOOD = 1.5
"""Ratio of residuals up to which a period counts as equal to the best."""
PER_TICK = 8
"""Number of candidate periods fitted per tick: a round takes half a second at most, and a slice
not much longer than with one period."""
ROUND_S = 2.0
"""Time from the start of one round to that of the next [s]. Assumed."""
SPARSE_S = 3.0
"""Periods above this are searched for in half the places [s]."""
NOISE = 0.1
"""Part of the variance of the places by which residuals may differ, too [1]."""
ALIKE = 0.01
"""Difference below which two periods of a leader are one [1]. Assumed: a refinement spans it."""
REFINED = 4
"""Number of candidates per axis that are refined."""
OFFSET_S = 0.25
"""Time constant of the mean error of the fit in the newest places [s]. Assumed."""


class Fit:
    """Mean, period and overtones of one axis, and the recent mean error."""

    def __init__(self, period_s: float, weights: Vector, since_s: float) -> None:
        self.period_s = period_s
        """Period [s]."""
        self._weights: list[float] = weights.tolist()
        self._since = since_s
        self.missed = 0.0
        """Mean error of the fit in the newest places [rad]."""

    def curve(self, t: float) -> float:
        """Return the fitted curve [rad]."""
        phase = 2 * pi * (t - self._since) / self.period_s
        w, cosine, sine = self._weights, cos(phase), sin(phase)
        value, c, s = w[0], 1.0, 0.0
        for k in range(1, 2 * OVERTONES, 2):
            c, s = c * cosine - s * sine, s * cosine + c * sine
            value += w[k] * c + w[k + 1] * s
        return value

    def at(self, t: float) -> float:
        """Predict the place [rad]."""
        return self.curve(t) + self.missed

    def see(self, dt: float, t: float, place: float) -> None:
        """Correct the mean error with a new place."""
        self.missed += min(1.0, dt / OFFSET_S) * (place - self.curve(t) - self.missed)

    def move(self, by: float) -> None:
        """Add a constant to the curve."""
        self._weights[0] += by


class PeriodSearch:
    """Fits of both axes, renewed by rounds of search.

    Args:
        leader: search whose periods are the only candidates; None if all are.
    """

    def __init__(self, leader: PeriodSearch | None = None) -> None:
        self._leader = leader
        self.fits: list[Fit | None] = [None, None]
        """Present fit of each axis; None while no period is known."""
        self._round: Iterator[None] | None = None
        self._t: float | None = None
        self._next = 0.0
        self._moved = np.zeros(2)

    def update(self, past: PlaceHistory, variance: Pair) -> None:
        """Add the newest place of the past, and start a round if none is running."""
        t = float(past.times[-1])
        for fit, place in zip(self.fits, past.places[:, -1].tolist(), strict=True):
            if fit and self._t is not None:
                fit.see(t - self._t, t, place)
        self._t = t
        if self._round is None and t >= max(self._next, past.times[0] + LEAST_S):
            self._round, self._next = self._search(past, variance), t + ROUND_S

    def work(self) -> None:
        """Do one slice of the search."""
        if self._round is not None:
            next(self._round, None)

    def move(self, by: Pair) -> None:
        """Add a constant to all the past."""
        self._moved += by
        for fit, shift in zip(self.fits, by, strict=True):
            if fit:
                fit.move(shift)

    def rewrite(self, past: PlaceHistory) -> None:
        """Fit a replaced past with the present periods; the search starts again."""
        self._round, self._next = None, 0.0
        sample = Sample(past)
        for axis, fit in enumerate(self.fits):
            if fit:
                _, weights, _ = refined(sample, axis, fit.period_s, 0)
                self._publish(past, axis, fit.period_s, weights, float(past.times[-1]))

    def _search(self, past: PlaceHistory, variance: Pair) -> Iterator[None]:
        sample = Sample(past)
        end, self._moved = float(past.times[-1]), np.zeros(2)
        starts: list[list[float]] = [[], []]
        if self._leader:
            known = sorted(fit.period_s for fit in self._leader.fits if fit)
            if len(known) == 2 and known[1] < (1 + ALIKE) * known[0]:
                known.pop()
            starts = [known.copy(), known.copy()]
        else:
            sparse = Sample(past, 2)
            periods = PERIODS_S[sample.length_s / CYCLES > PERIODS_S]
            left = []
            for n in range(0, len(periods), PER_TICK):
                some = periods[n : n + PER_TICK]
                left.append(residuals_of(sparse if some[0] > SPARSE_S else sample, some))
                yield
            residuals = np.concatenate(left)
            starts = [_minima(residuals[:, axis], periods) for axis in range(2)]
        for axis in range(2):
            tried = []
            fit = self.fits[axis]
            if fit:
                starts[axis].append(fit.period_s)
            for start in starts[axis]:
                tried.append(refined(sample, axis, start, 2))
                yield
            usable = [one for one in tried if one[0] * CYCLES < sample.length_s]
            if usable:
                least = min(one[2] for one in usable)
                good = [
                    one
                    for one in usable
                    if one[2] <= AS_GOOD * least + NOISE * variance[axis] + 1e-12
                ]
                shortest = min(one[0] for one in good)
                near = [one for one in good if one[0] <= 1.1 * shortest]
                period, weights, _ = min(near, key=lambda one: one[2])
                weights[0] += self._moved[axis]
                self._publish(past, axis, period, weights, end)
            yield
        self._round = None

    def _publish(
        self, past: PlaceHistory, axis: int, period: float, weights: Vector, since_s: float
    ) -> None:
        fit = Fit(period, weights, since_s)
        recent = np.flatnonzero(past.times > past.times[-1] - 3 * OFFSET_S)
        before = float(past.times[recent[0]])
        for n in recent.tolist():
            t = float(past.times[n])
            fit.see(t - before, t, float(past.places[axis, n]))
            before = t
        self.fits[axis] = fit


def _minima(residuals: Vector, periods: Vector) -> list[float]:
    """Periods of the lowest local minima."""
    padded = np.concatenate([[np.inf], residuals, [np.inf]])
    lower = (padded[1:-1] <= padded[:-2]) & (padded[1:-1] < padded[2:])
    places = np.flatnonzero(lower)
    best = places[np.argsort(residuals[places])[:REFINED]]
    found: list[float] = periods[best].tolist()
    return found
