"""Prediction of the target: several predictors, and a selection by their recent errors.

Each receives noisy positions of the target at past times and predicts a later one. The random walk
predicts that the target stays; constant velocity, with low and with high acceleration, that it
continues; the harmonic predictor fits a period with overtones. Predictions are compared with the
later positions, and the predictor with the smallest error is selected once it is clearly better.

Reference:
    Y. Bar-Shalom, X. R. Li and T. Kirubarajan, Estimation with Applications to Tracking and
    Navigation, 2001, ch. 6 (white-noise acceleration) and ch. 11 (multiple models).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Vector

PERIODS_S = np.geomspace(2.0, 30.0, 70)
"""Candidate periods [s]. Assumed: from heavy breathing to a slow circle."""
OVERTONES = 3
"""Number of harmonics, the fundamental included."""
WINDOW_S = 30.0
"""Length of the past used by the harmonic predictor [s]."""
LEAST_S = 4.0
"""Shortest past that is fitted [s]."""
REFIT_S = 0.5
"""Time between fits [s]."""
POINTS = 250
"""Largest number of positions fitted; of more, every second, third, ... is used."""
MEMORY_S = 1.5
"""Time constant with which past errors decay [s]. Source: tuned on the default twin."""
CLEARLY = 0.9
"""Another predictor is selected if its mean squared error is below this fraction of the present
one's, which prevents frequent switching."""
SURE, SURE_AGAIN = 25, 50
"""Number of comparisons before a selection, one or two seconds: after the first identification, and
after a change of the internal model."""
AS_GOOD = 1.5
"""Ratio of residuals up to which a period counts as equal to the best: of a period and its
multiples, which fit equally well, the shortest is selected."""
RECENT = 150
"""Number of positions that restart a filter when the past is rewritten: 6 s."""


@dataclass
class Mover:
    """Kalman filter of position and velocity, the same on both axes, with white acceleration."""

    density: float
    """Spectral density of the acceleration [rad2/s3]; of the velocity where `still` [rad2/s]."""
    still: bool = False
    """Whether it is a random walk, without velocity."""
    t: float | None = None
    """Time of the newest position [s]."""
    position: Pair = (0.0, 0.0)
    """Estimated position [rad]."""
    velocity: Pair = (0.0, 0.0)
    """Estimated velocity [rad/s]."""
    covariance: tuple[float, float, float] = (1.0, 0.0, 1.0)
    """Variance of the position, covariance, variance of the velocity."""

    def update(self, t: float, seen: Pair, variance: float) -> None:
        """Add one position; one that is not newer is ignored."""
        if self.t is None:
            self.t, self.position, self.velocity = t, seen, (0.0, 0.0)
            self.covariance = (variance, 0.0, 0.0 if self.still else 0.25)
            return
        dt = t - self.t
        if dt <= 0:
            return
        a, b, c = self.covariance
        q = self.density
        if self.still:
            a += q * dt
        else:
            a += 2 * b * dt + c * dt**2 + q * dt**3 / 3
            b += c * dt + q * dt**2 / 2
            c += q * dt
        gain, slope = a / (a + variance), b / (a + variance)
        (x, y), (u, v) = self.position, self.velocity
        x, y = x + u * dt, y + v * dt
        off_x, off_y = seen[0] - x, seen[1] - y
        self.position = x + gain * off_x, y + gain * off_y
        self.velocity = u + slope * off_x, v + slope * off_y
        self.covariance = ((1 - gain) * a, (1 - gain) * b, c - slope * b)
        self.t = t

    def at(self, t: float) -> Pair:
        """Predict the position at a time [rad]."""
        dt = 0.0 if self.t is None else t - self.t
        (x, y), (u, v) = self.position, self.velocity
        return x + u * dt, y + v * dt


@dataclass
class Harmonic:
    """Mean, period and overtones fitted to the past, and the recent mean error."""

    times: list[float] = field(default_factory=list)
    """Times of the positions [s]."""
    positions: list[Pair] = field(default_factory=list)
    """Positions of the target [rad]."""
    period_s: float | None = None
    """Fitted period [s]; None while there is none."""
    weights: list[list[float]] = field(default_factory=list)
    """Coefficients of 1, cosines and sines, each for both axes [rad]."""
    fitted: float = 0.0
    """Time of the last fit, at which the phases are 0 [s]."""
    missed: Pair = (0.0, 0.0)
    """Mean error of the fit in the newest positions [rad]."""

    def update(self, t: float, seen: Pair) -> None:
        """Add one position, and repeat the fit from time to time."""
        if self.times and t <= self.times[-1]:
            return
        self.times.append(t)
        self.positions.append(seen)
        while self.times[0] < t - WINDOW_S:
            del self.times[0], self.positions[0]
        if t - self.fitted > REFIT_S:
            self.fit()
        if self.period_s:
            x, y = self._curve(t)
            u, v = self.missed
            self.missed = u + 0.15 * (seen[0] - x - u), v + 0.15 * (seen[1] - y - v)

    def at(self, t: float) -> Pair | None:
        """Predict the position at a time [rad]; None while no period is known."""
        if not self.period_s:
            return None
        x, y = self._curve(t)
        return x + self.missed[0], y + self.missed[1]

    def fit(self) -> None:
        """Fit the past; older positions count less, so that the start is forgotten."""
        end = self.times[-1]
        if end - self.times[0] < LEAST_S:
            return
        self.fitted = end
        every = len(self.times) // POINTS + 1
        times = np.array(self.times[::-every]) - end
        positions = np.array(self.positions[::-every])
        trust = np.exp(times / WINDOW_S)[:, None]
        scan = PERIODS_S[-times[-1] / 1.15 > PERIODS_S]
        if self.period_s:
            scan = np.concatenate([scan, self.period_s * np.linspace(0.97, 1.03, 13)])
        tried = []
        for period in scan.tolist():
            waves = _waves(times, period)
            weights = np.linalg.lstsq(trust * waves, trust * positions, rcond=1e-4)[0]
            tried.append(
                (float((trust * (waves @ weights - positions) ** 2).sum()), period, weights)
            )
        if not tried:
            return
        least = min(left for left, _, _ in tried)
        shortest = min(period for left, period, _ in tried if left <= AS_GOOD * least + 1e-9)
        near = [candidate for candidate in tried if candidate[1] <= 1.1 * shortest]
        _, self.period_s, best = min(near, key=lambda candidate: candidate[0])
        self.weights = best.tolist()
        self.missed = (0.0, 0.0)

    def _curve(self, t: float) -> Pair:
        assert self.period_s is not None
        x, y = (_waves(np.array([t - self.fitted]), self.period_s) @ np.array(self.weights))[0]
        return float(x), float(y)


@dataclass
class Bank:
    """Predictors, their recent errors, and the selection."""

    movers: list[Mover]
    """Random walk and constant velocity."""
    harmonic: Harmonic | None = None
    """Periodic motion."""
    chosen: int = 0
    """Index of the selected predictor; the harmonic one comes last."""
    errors: list[float] = field(default_factory=list)
    """Mean squared error of each [rad2]."""
    judged: list[int] = field(default_factory=list)
    """Number of comparisons of each."""
    wait: int = SURE
    """Number of comparisons before a selection."""
    said: list[tuple[float, list[Pair | None]]] = field(default_factory=list)
    """Predictions [rad], with the times that they are for [s]."""
    t: float | None = None
    """Time of the newest position [s]."""

    def update(self, t: float, seen: Pair, variance: float, horizon_s: float) -> None:
        """Add one position; score the predictions for this time, and make one for a later time.

        Args:
            t: time of the position [s].
            seen: position [rad].
            variance: variance of each coordinate [rad2].
            horizon_s: prediction horizon [s].
        """
        count = len(self.all_at(t))
        self.errors, self.judged = self.errors or [1.0] * count, self.judged or [0] * count
        share = 1.0 if self.t is None else min(1.0, max(0.0, t - self.t) / MEMORY_S)
        self.t = t
        while self.said and self.said[0][0] <= t + 1e-6:
            when, predictions = self.said.pop(0)
            if t - when > 0.06:  # frames were lost in between: nothing to compare with
                continue
            for n, predicted in enumerate(predictions):
                if predicted is not None:
                    squared = (predicted[0] - seen[0]) ** 2 + (predicted[1] - seen[1]) ** 2
                    self.judged[n] += 1
                    weight = max(share, 1 / self.judged[n])  # a plain mean at first
                    self.errors[n] += weight * (squared - self.errors[n])
        for mover in self.movers:
            mover.update(t, seen, variance)
        if self.harmonic:
            self.harmonic.update(t, seen)
        self.said.append((t + horizon_s, self.all_at(t + horizon_s)))
        best = int(np.argmin(self.errors))
        if self.judged[best] < self.wait:
            return
        if self.errors[best] < CLEARLY * self.errors[self.chosen]:
            self.chosen = best

    def forget(self, wait: int) -> None:
        """Keep the selection until each was compared a number of times again."""
        self.judged, self.wait = [], wait

    def rewrite(self, times: list[float], positions: list[Pair], variance: float) -> None:
        """Replace the past by the positions that another model of the tip gives.

        Args:
            times: exposure times of the frames [s].
            positions: positions of the target [rad].
            variance: variance of each coordinate [rad2].
        """
        self.said = []  # made with the other model
        for mover in self.movers:
            mover.t = None
            for t, position in zip(times[-RECENT:], positions[-RECENT:], strict=True):
                mover.update(t, position, variance)
        if self.harmonic and times:
            self.harmonic.times, self.harmonic.positions = list(times), list(positions)
            self.harmonic.fit()

    def all_at(self, t: float) -> list[Pair | None]:
        """Prediction of each predictor for a time [rad]; None where it has none yet."""
        last = [self.harmonic.at(t)] if self.harmonic else []
        return [*(mover.at(t) for mover in self.movers), *last]

    def at(self, t: float) -> Pair:
        """Prediction of the selected predictor [rad]."""
        predicted = self.all_at(t)[self.chosen]
        return self.movers[0].at(t) if predicted is None else predicted


def _waves(times: Vector, period: float) -> Vector:
    phase = 2 * np.pi / period * np.outer(times, np.arange(1, OVERTONES + 1))
    return np.concatenate([np.ones((len(times), 1)), np.cos(phase), np.sin(phase)], axis=1)
