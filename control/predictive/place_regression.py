"""Prediction of the target by linear regression on its recent past.

Of the place x at a time s, with means m_k of the past in intervals that end at s, the displacement
x(s + h) - x(s) is regressed on m_k - x(s), x(s) and a constant, per axis, by least squares with a
ridge, in which older rows count exponentially less. One Gram matrix serves all horizons h. Noise in
the places shrinks the weights as much as is best for prediction from places as noisy; without
anything to learn the target is predicted to stay.

Reference:
    The least-squares predictor tends to the Wiener filter of its taps: P. Whittle, Prediction and
    Regulation by Linear Least-Square Methods, 1983.
"""

from __future__ import annotations

from math import exp

import numpy as np

from endolock.control.predictive.place_history import PlaceHistory
from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Vector

STEP_S = 0.04
"""Spacing of the interpolated past [s]: 25 frames per second."""
WIDTHS = (1, 1, 1, 1, 2, 2, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4)
"""Widths of the intervals, the newest first, in steps. Assumed: 0.16 s, finer near now."""
HORIZON_STEP_S = 0.15
"""Spacing of the horizons that are fitted [s]: a fifth of a heartbeat."""
MEMORY_S = 30.0
"""Time constant with which rows are forgotten [s]. Assumed: three periods of slow strokes."""
RIDGE, RIDGE_OF_ERROR = 3.0, 20.0
"""Ridge, in variances of a place and in mean squared errors of the predictions [1]. Assumed:
weights are about 1 at most, and the errors of a dozen neighbouring rows are one and the same."""
JUDGED_S = 5.0
"""Time constant of the mean squared error [s]."""
FIRST_RAD = 0.05
"""Error that is expected at least in the first second [rad]. Assumed."""
SCALE_RAD = 0.1
"""The constant regressor [rad]: of the size of the others, since they share a ridge."""
LEAST_ROWS = 40
"""Number of rows before it predicts [1]: 1.6 s of frames, a little less than it looks back."""
LEARN_EVERY = 3
"""Number of updates after which new rows are learnt and the weights computed again [1]."""
LONGEST_S = 6.0
"""Longest horizon that is regressed [s]: latency and lag."""
PREVIEW_S = 0.35
"""Time after the horizon that is predicted, too [s]."""

_STEPS = sum(WIDTHS)
SPAN_S = _STEPS * STEP_S
"""Length of the past regressed on [s]."""
_BACK = -STEP_S * np.arange(_STEPS + 1)
_MEANS = np.zeros((_STEPS, len(WIDTHS)))
for _k, _width in enumerate(WIDTHS):
    _MEANS[sum(WIDTHS[:_k]) : sum(WIDTHS[: _k + 1]), _k] = 1 / _width
_COUNT = len(WIDTHS) + 2
_SAME = np.eye(_COUNT)
_ASKED = -1 - int(PREVIEW_S / HORIZON_STEP_S)  # the horizon asked for, before the preview


class PlaceRegression:
    """Regression of both axes, each with its own weights.

    The rows of one axis are its regressors (count) and displacements (horizons); rows wait until
    their last horizon is over.
    """

    def __init__(self) -> None:
        self._ahead = np.array([0.0])
        self._gram = np.zeros((2, _COUNT, _COUNT))
        self._moments = np.zeros((2, _COUNT, 1))
        self._rows = 0.0
        self._fade = 1.0  # of the sums since they were renewed
        self._waiting: list[tuple[float, Vector, Vector]] = []
        self._updates = 0
        self._t = 0.0
        self._origin: Vector | None = None
        self._path: list[list[float]] | None = None
        self._weights: Vector | None = None
        self._variance = np.zeros(2)
        self._missed = np.zeros(2)
        self._judged = 0

    def update(self, past: PlaceHistory, t: float, variance: Pair, horizon_s: float) -> None:
        """Learn from the rows that became complete, and predict from the newest place.

        Args:
            past: all places, that of `t` included.
            t: time of the newest place [s].
            variance: its variance on each axis [rad2].
            horizon_s: time ahead that will be asked for [s]; below 0 where an exposure is
                believed to be later than now.
        """
        if self._origin is None:
            self._origin = past.places[:, -1].copy()
        self._variance = np.array(variance)
        ahead_s = min(max(horizon_s, 0.0), LONGEST_S) + PREVIEW_S
        steps = int(np.ceil(ahead_s / HORIZON_STEP_S - 1e-9)) + 1
        if steps > len(self._ahead):
            self._ahead, self._weights = HORIZON_STEP_S * np.arange(steps), None
            self.relearn(past)
            return
        self._fade *= exp(-(t - self._t) / MEMORY_S) if self._rows else 1.0
        self._t = t
        self._waiting.append((t, *self._regressors(past, np.array([t]))))
        self._updates += 1
        due = self._updates % LEARN_EVERY == 0
        if due:
            self._learn_complete(past, t)
        self._predict(past, *self._waiting[-1], again=due)

    def relearn(self, past: PlaceHistory) -> None:
        """Learn from the whole past again, from every fourth place, and predict."""
        self._gram = np.zeros((2, _COUNT, _COUNT))
        self._moments = np.zeros((2, _COUNT, len(self._ahead)))
        self._rows, self._fade, self._path, self._waiting = 0.0, 1.0, None, []
        times = past.times
        if self._origin is None or not len(times):
            return
        self._t = end = float(times[-1])
        complete = times <= end - self._ahead[-1] - STEP_S
        waiting = times[~complete]
        rows, now = self._regressors(past, waiting)
        for n, t in enumerate(waiting.tolist()):
            self._waiting.append((t, rows[:, n : n + 1], now[:, n : n + 1]))
        anchors = times[complete & (times >= past.since_s + SPAN_S)][::4]
        if len(anchors):
            regressors, now = self._regressors(past, anchors)
            trust = 4 * np.exp((anchors - end) / MEMORY_S)
            self._learn(regressors, self._moved(past, anchors, now), trust)
        self._predict(past, *self._waiting[-1])

    def ahead(self, axis: int, dt: float) -> float | None:
        """Predict the place of an axis a time after the newest one [rad]; None if not learnt."""
        if self._path is None:
            return None
        path = self._path[axis]
        where = min(max(dt / HORIZON_STEP_S, 0.0), len(path) - 1.0)
        n = min(int(where), len(path) - 2)
        u = where - n
        one, two = path[n], path[n + 1]
        before = path[n - 1] if n else 2 * one - two
        after = path[n + 2] if n + 2 < len(path) else 2 * two - one
        slope, end_slope = (two - before) / 2, (after - one) / 2
        bow, end_bow = slope - (two - one), (two - one) - end_slope
        return one + u * (two - one) + u * (1 - u) * ((1 - u) * bow + u * end_bow)

    def move(self, by: Pair) -> None:
        """Add a constant to all the past."""
        if self._origin is not None:
            self._origin += by
        if self._path is not None:
            self._path = [[x + d for x in path] for path, d in zip(self._path, by, strict=True)]

    def _regressors(self, past: PlaceHistory, anchors: Vector) -> tuple[Vector, Vector]:
        """Regressors (2, rows, count) and places (2, rows) at times."""
        assert self._origin is not None
        rows = len(anchors)
        times = (anchors[:, None] + _BACK).ravel()
        places = past.at(times).reshape(2, rows, _STEPS + 1)
        now = places[:, :, 0]
        found = np.empty((2, rows, _COUNT))
        found[:, :, 2:] = places[:, :, 1:] @ _MEANS - now[:, :, None]
        found[:, :, 0] = SCALE_RAD
        found[:, :, 1] = now - self._origin[:, None]
        return found, now

    def _moved(self, past: PlaceHistory, anchors: Vector, now: Vector) -> Vector:
        """Displacements from times to each horizon later, (2, rows, horizons)."""
        later = anchors[:, None] + self._ahead
        later[:, 0] = anchors + STEP_S
        times = np.concatenate([later, anchors[:, None] - STEP_S], axis=1)
        places = past.at(times.ravel()).reshape(2, len(anchors), -1)
        # now, the mean of the neighbours: a smoothed place, of other noise
        places[:, :, 0] = (places[:, :, 0] + places[:, :, -1]) / 2
        moved: Vector = places[:, :, :-1] - now[:, :, None]
        return moved

    def _learn_complete(self, past: PlaceHistory, t: float) -> None:
        """Learn from the rows whose horizons are over."""
        reach = float(self._ahead[-1]) + STEP_S
        count = sum(1 for row in self._waiting if row[0] + reach <= t)
        ready, self._waiting = self._waiting[:count], self._waiting[count:]
        ready = [row for row in ready if past.since_s <= row[0] - SPAN_S]
        if not ready:
            return
        anchors = np.array([row[0] for row in ready])
        regressors = np.concatenate([row[1] for row in ready], axis=1)
        now = np.concatenate([row[2] for row in ready], axis=1)
        moved = self._moved(past, anchors, now)
        if self._weights is not None:  # which were not fitted to these rows
            self._judged += len(ready)
            off = moved[:, :, _ASKED] - (regressors @ self._weights)[:, :, _ASKED]
            part = max(1 / self._judged, STEP_S / JUDGED_S) * len(ready)
            self._missed += min(part, 1.0) * ((off**2).mean(axis=1) - self._missed)
        self._learn(regressors, moved, np.ones(len(ready)))

    def _learn(self, regressors: Vector, moved: Vector, trust: Vector) -> None:
        weighted = (regressors * trust[:, None]).swapaxes(1, 2)
        self._forget()
        self._gram += weighted @ regressors
        self._moments += weighted @ moved
        self._rows += float(trust.sum())

    def _forget(self) -> None:
        """Let the sums count less by the time that has passed."""
        self._gram *= self._fade
        self._moments *= self._fade
        self._rows *= self._fade
        self._fade = 1.0

    def _predict(
        self, past: PlaceHistory, t: float, regressors: Vector, now: Vector, again: bool = True
    ) -> None:
        """Predict from the newest place, after computing the weights again if wanted."""
        if self._fade * self._rows < LEAST_ROWS or past.since_s > t - SPAN_S:
            self._path = None
            return
        if self._weights is None or again:
            early = FIRST_RAD if self._judged * STEP_S < 1 else 0.0
            missed = np.maximum(self._missed, early**2)
            ridge = RIDGE * self._variance + RIDGE_OF_ERROR * missed + 1e-9
            self._forget()
            gram = self._gram + ridge[:, None, None] * _SAME
            self._weights = np.asarray(np.linalg.solve(gram, self._moments))
        self._path = (now + (regressors @ self._weights)[:, 0]).tolist()
