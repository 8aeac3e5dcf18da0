"""Prediction of the target on both axes, each by a blend of predictors of its own.

The predictors of an axis: it stays (a random walk); it continues at its velocity, estimated slowly
and quickly; a regression on its recent past; a periodic curve with overtones; and the place one
period ago. They are blended by their errors out of sample (see `prediction_blend`), and none moves
the target further than `REACH` times what it was seen to move within the horizon.

Example:
    prediction = TargetPrediction(
        walk_density=0.02, densities=(0.02, 0.5), harmonic=True, regression=True
    )
    prediction.update(t, place, variance, horizon_s=0.48)  # at each frame
    prediction.work()  # in each control period
    ahead = prediction.at(t + 0.48)
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, sqrt

import numpy as np

from endolock.control.predictive.axis_filters import AxisFilter
from endolock.control.predictive.period_search import Fit, PeriodSearch
from endolock.control.predictive.place_history import GAP_S, PlaceHistory
from endolock.control.predictive.place_regression import PREVIEW_S, PlaceRegression
from endolock.control.predictive.prediction_blend import PredictionBlend
from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Vector

REACH = 1.2
"""Largest predicted displacement, in the largest seen within a horizon [1]. Assumed: the target may
speed up by a fifth."""
SURPRISE = 3.0
"""Distance of the newest place from that of a predictor up to which it counts as noise, in standard
deviations [1]; beyond it the predictor is moved along, so that none misses the start of a motion by
more than "it stays" does."""
REACH_MEMORY_S = 30.0
"""Time constant with which the largest displacement is forgotten [s]. Assumed."""
WEIGH_EVERY = 6
"""Number of updates after which an axis is weighed again [1], in turns; at once after a predictor
came or went."""
REPEATED_S = (-0.08, -0.04, 0.0, 0.04, 0.08)
"""Times around one period ago whose places are averaged [s]: five frames."""
RESTART_S = 2.0
"""Length of the past that restarts a filter when the past is replaced [s]."""


class TargetPrediction:
    """Blended prediction of both axes.

    Args:
        walk_density: spectral density of the random walk [rad2/s].
        densities: spectral density of the acceleration for each predictor of constant velocity
            [rad2/s3].
        harmonic: whether periodic motion is searched for.
        leader: prediction whose periods are those that are possible; None if any is.
        regression: whether the place is regressed on the past.
    """

    def __init__(
        self,
        *,
        walk_density: float,
        densities: Sequence[float],
        harmonic: bool,
        regression: bool,
        leader: TargetPrediction | None = None,
    ) -> None:
        self._filters = [
            [AxisFilter(walk_density, still=True), *(AxisFilter(q) for q in densities)]
            for _ in range(2)
        ]
        self._periods: PeriodSearch | None = None
        if harmonic:
            self._periods = PeriodSearch(leader._periods if leader else None)
        self._regression = PlaceRegression() if regression else None
        self._names = ["stays", *(f"velocity_{n + 1}" for n in range(len(densities)))]
        self._names += ["regression"] if regression else []
        self._names += ["harmonic", "repeats"] if harmonic else []
        self._repeats = len(self._names) - 1 if harmonic else -1
        start = sqrt(walk_density)  # of a random walk in one second
        self._blends = [PredictionBlend(len(self._names), start) for _ in range(2)]
        self._past = PlaceHistory()
        self._t: float | None = None
        self._horizon = 0.0
        self._reach = [0.0, 0.0]
        self._said: list[_Said] = []
        self._updates = 0
        self._present: list[list[bool]] = [[], []]
        self._repeat_off = [0.0, 0.0]
        self._surprise: list[list[float]] = [[], []]

    @property
    def error_rad(self) -> Pair:
        """Expected rms error of `at` at the horizon on each axis, out of sample [rad]."""
        first, second = self._blends
        return first.error_rad, second.error_rad

    @property
    def weights(self) -> tuple[dict[str, float], dict[str, float]]:
        """Share of each predictor in the blend of each axis, of sum 1."""
        first, second = (
            dict(zip(self._names, blend.shares, strict=True)) for blend in self._blends
        )
        return first, second

    def update(self, t: float, place: Pair, variance: Pair, horizon_s: float) -> None:
        """Add one measured place; one that is not newer than the others is ignored.

        Args:
            t: exposure time [s].
            place: place of the target [rad].
            variance: variance of the measurement on each axis [rad2].
            horizon_s: time ahead that predictions will be asked for [s].
        """
        before = self._t
        if before is not None and t <= before:
            return
        self._past.add(t, place)
        self._t, self._horizon = t, horizon_s
        dt = t - before if before is not None else 0.0
        for filters, seen, squared in zip(self._filters, place, variance, strict=True):
            for one in filters:
                one.update(t, seen, squared)
        then = self._past.one_at(t - horizon_s)
        moved = [abs(now - x) for now, x in zip(place, then[:2], strict=True)]
        fade = exp(-dt / REACH_MEMORY_S)
        self._reach = [max(fade * r, m) for r, m in zip(self._reach, moved, strict=True)]
        if self._regression:
            self._regression.update(self._past, t, variance, horizon_s)
        if self._periods:
            self._periods.update(self._past, variance)
        self._judge(t, dt, variance)
        self._find_repeats(t)
        self._find_surprises(variance)
        ahead = [self._each(axis, horizon_s) for axis in range(2)]
        self._updates += 1
        for axis, blend in enumerate(self._blends):
            present = [x is not None for x in ahead[axis]]
            due = self._updates % WEIGH_EVERY == axis * WEIGH_EVERY // 2
            if due or present != self._present[axis]:
                blend.weigh(present)
                self._present[axis] = present
        raw = [blend.raw(each) for blend, each in zip(self._blends, ahead, strict=True)]
        blended = [blend.blended(each) for blend, each in zip(self._blends, ahead, strict=True)]
        self._said.append(_Said(t + horizon_s, ahead, blended, raw))

    def at(self, t: float) -> Pair:
        """Predict the place at a time, from that of the newest place on [rad]."""
        if self._t is None:
            return 0.0, 0.0
        dt = t - self._t
        return self._blended(0, dt), self._blended(1, dt)

    def stays_at(self) -> Pair:
        """Return the filtered newest place [rad]."""
        first, second = (filters[0].place for filters in self._filters)
        return first, second

    def work(self) -> None:
        """Do one slice of the search for periods; to be called in each control period."""
        if self._periods:
            self._periods.work()

    def move(self, by: Pair) -> None:
        """Add a constant to all the past [rad]; the errors stay the same."""
        if self._t is None:
            return
        self._past.move(by)
        for filters, shift in zip(self._filters, by, strict=True):
            for one in filters:
                one.place += shift
        if self._regression:
            self._regression.move(by)
        if self._periods:
            self._periods.move(by)
        self._said = [said.moved(by) for said in self._said]

    def rewrite(self, times: Vector, places: Vector, variance: Pair) -> None:
        """Replace the past by places from another model of the tip; the errors are kept.

        Args:
            times: exposure times [s], increasing.
            places: places of the target, n x 2 [rad].
            variance: variance of the places on each axis [rad2].
        """
        if not len(times):
            return
        self._past.replace(times, places.T)
        self._t = end = float(times[-1])
        self._said = []  # made with the other model
        known = self._past.times
        moved = np.abs(self._past.places - self._past.at(known - self._horizon))
        self._reach = moved.max(axis=1).tolist()
        recent = slice(int(np.searchsorted(times, end - RESTART_S, side="right")), None)
        anew = times[recent].tolist()
        for axis, filters in enumerate(self._filters):
            seen = places[recent, axis].tolist()
            for one in filters:
                one.t = None
                for t, place in zip(anew, seen, strict=True):
                    one.update(t, place, variance[axis])
        if self._regression:
            self._regression.relearn(self._past)
        if self._periods:
            self._periods.rewrite(self._past)
        self._find_repeats(end)
        self._find_surprises(variance)

    def _judge(self, t: float, dt: float, variance: Pair) -> None:
        """Compare the predictions for times up to now with what was measured."""
        for blend in self._blends:
            blend.fade(dt)
        due = [said for said in self._said if said.t <= t]
        self._said = [said for said in self._said if said.t > t]
        if dt > GAP_S:
            return  # nothing was measured at those times
        for said in due:
            *seen, factor = self._past.one_at(said.t)
            for axis, blend in enumerate(self._blends):
                blend.judge(
                    said.each[axis],
                    said.blended[axis],
                    said.raw[axis],
                    seen[axis],
                    factor * variance[axis],
                )

    def _find_repeats(self, t: float) -> None:
        """Find how far the newest places are from those of one period ago."""
        if not self._periods:
            return
        newest = [t + after - REPEATED_S[-1] for after in REPEATED_S]
        for axis, fit in enumerate(self._periods.fits):
            if fit:
                then = [one - fit.period_s for one in newest]
                self._repeat_off[axis] = self._past.mean_at(axis, newest) - self._past.mean_at(
                    axis, then
                )

    def _find_surprises(self, variance: Pair) -> None:
        """Find how far the newest place is from where each predictor has it, beyond the noise."""
        for axis, squared in enumerate(variance):
            self._surprise[axis] = []
            noise, stays = SURPRISE * sqrt(squared), self._filters[axis][0].place
            for x in self._each(axis, 0.0, repeats=False):  # which follow anyway
                off = stays - x if x is not None else 0.0
                self._surprise[axis].append(off - min(max(off, -noise), noise))

    def _each(self, axis: int, dt: float, repeats: bool = True) -> list[float | None]:
        """Prediction of each predictor a time after the newest place [rad]; None without one."""
        each = [
            None if n == self._repeats and not repeats else self._one(axis, n, dt)
            for n in range(len(self._names))
        ]
        low, high = self._bounds(axis, dt)
        surprise = self._surprise[axis] or [0.0] * len(each)
        return [
            x if x is None else min(max(x + off, low), high)
            for x, off in zip(each, surprise, strict=True)
        ]

    def _blended(self, axis: int, dt: float) -> float:
        """Blend of the predictors that have a share, a time after the newest place [rad]."""
        found = stays = self._filters[axis][0].place
        shares = self._blends[axis].shares
        if shares[0] == 1.0:
            return stays
        low, high = self._bounds(axis, dt)
        surprise = self._surprise[axis]
        for n, share in enumerate(shares):
            if n and share:
                x = self._one(axis, n, dt)
                if x is not None:
                    found += share * (min(max(x + surprise[n], low), high) - stays)
        return found

    def _bounds(self, axis: int, dt: float) -> Pair:
        """Range within which the target may be a time after the newest place [rad]."""
        stays = self._filters[axis][0].place
        reach = REACH * self._reach[axis] * max(1.0, dt / max(self._horizon, 1e-3))
        return stays - reach, stays + reach

    def _one(self, axis: int, n: int, dt: float) -> float | None:
        """Prediction of one predictor a time after the newest place [rad]; None without one."""
        filters = self._filters[axis]
        near = min(dt, self._horizon + PREVIEW_S)  # in a gap, velocity ends there
        if n < len(filters):
            return filters[n].ahead(near)
        if self._regression and n == len(filters):
            return self._regression.ahead(axis, near)
        assert self._periods
        assert self._t is not None
        fit = self._periods.fits[axis]
        if not fit:
            return None
        return self._repeated(axis, fit, dt) if n == self._repeats else fit.at(self._t + dt)

    def _repeated(self, axis: int, fit: Fit, dt: float) -> float | None:
        """Place one period ago, corrected by the newest ones [rad]; None if it is too long ago."""
        assert self._t is not None
        then = self._t - fit.period_s
        if then + 2 * REPEATED_S[0] < self._past.first_s:
            return None
        then += dt
        moments = [then + after for after in REPEATED_S]
        return self._past.mean_at(axis, moments) + self._repeat_off[axis]


class _Said:
    """Predictions made for a time: of each predictor, blended, and blended with g = 1."""

    def __init__(
        self, t: float, each: list[list[float | None]], blended: list[float], raw: list[float]
    ) -> None:
        self.t, self.each, self.blended, self.raw = t, each, blended, raw

    def moved(self, by: Pair) -> _Said:
        return _Said(
            self.t,
            [
                [None if x is None else x + d for x in each]
                for each, d in zip(self.each, by, strict=True)
            ],
            [x + d for x, d in zip(self.blended, by, strict=True)],
            [x + d for x, d in zip(self.raw, by, strict=True)],
        )
