"""Where a target will be: several predictors, and a choice by what each was worth lately.

Each is fed with noisy places of the target at past times and asked for a later one. The random walk
says that it stays; constant velocity, with little and with much acceleration, that it goes on; the
harmonic one fits a period with its overtones. What each said of a time is compared with what came,
and the one with the least error is believed once it is clearly better.

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
"""Periods that are tried [s]. Assumed: from heaving breath to a slow circle."""
OVERTONES = 3
WINDOW_S = 30.0
"""So much of the past carries the harmonic predictor [s]."""
LEAST_S = 4.0
"""Nothing is fitted to less [s]."""
REFIT_S = 0.5
POINTS = 250
"""Most places that are fitted; of more, every second, third, ... is taken."""
MEMORY_S = 1.5
"""Time constant with which past errors are forgotten [s]. Source: tuned on the default twin."""
CLEARLY = 0.9
"""Another predictor is chosen where its mean squared error is below this share of the present
one's: a guard against switching to and fro."""
SURE, SURE_AGAIN = 25, 50
"""A predictor is chosen after so many comparisons, one or two seconds: when the tip's motion begins
to be known, and when another model of it is believed."""
AS_GOOD = 1.5
"""A period is as good as the best if what it leaves is at most so many times as much: of a period
and its multiples, which explain as much, the shortest is meant."""
RECENT = 150
"""Places with which a filter starts anew when the past is rewritten: 6 s."""


@dataclass
class Mover:
    """Kalman filter of place and velocity, alike on both axes; acceleration is white noise."""

    density: float
    """Spectral density of the acceleration [rad2/s3]; of the velocity where `still` [rad2/s]."""
    still: bool = False
    """A random walk: there is no velocity."""
    t: float | None = None
    place: Pair = (0.0, 0.0)
    velocity: Pair = (0.0, 0.0)
    covariance: tuple[float, float, float] = (1.0, 0.0, 1.0)
    """Of place, of both, of velocity."""

    def update(self, t: float, seen: Pair, variance: float) -> None:
        """Take in one place; one that is no newer is left out."""
        if self.t is None:
            self.t, self.place, self.velocity = t, seen, (0.0, 0.0)
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
        (x, y), (u, v) = self.place, self.velocity
        x, y = x + u * dt, y + v * dt
        off_x, off_y = seen[0] - x, seen[1] - y
        self.place = x + gain * off_x, y + gain * off_y
        self.velocity = u + slope * off_x, v + slope * off_y
        self.covariance = ((1 - gain) * a, (1 - gain) * b, c - slope * b)
        self.t = t

    def at(self, t: float) -> Pair:
        """Say where the target will be."""
        dt = 0.0 if self.t is None else t - self.t
        (x, y), (u, v) = self.place, self.velocity
        return x + u * dt, y + v * dt


@dataclass
class Harmonic:
    """A mean, a period and its overtones, fitted to the past, and what that misses of late."""

    times: list[float] = field(default_factory=list)
    places: list[Pair] = field(default_factory=list)
    period_s: float | None = None
    weights: list[list[float]] = field(default_factory=list)
    """Of 1, cosines and sines, each for both axes [rad]."""
    fitted: float = 0.0
    """When; phases count from there [s]."""
    missed: Pair = (0.0, 0.0)

    def update(self, t: float, seen: Pair) -> None:
        """Take in one place, and fit anew now and then."""
        if self.times and t <= self.times[-1]:
            return
        self.times.append(t)
        self.places.append(seen)
        while self.times[0] < t - WINDOW_S:
            del self.times[0], self.places[0]
        if t - self.fitted > REFIT_S:
            self.fit()
        if self.period_s:
            x, y = self._curve(t)
            u, v = self.missed
            self.missed = u + 0.15 * (seen[0] - x - u), v + 0.15 * (seen[1] - y - v)

    def at(self, t: float) -> Pair | None:
        """Say where the target will be; None while no period is known."""
        if not self.period_s:
            return None
        x, y = self._curve(t)
        return x + self.missed[0], y + self.missed[1]

    def fit(self) -> None:
        """Fit to the past; what is older counts less, so that a start is forgotten."""
        end = self.times[-1]
        if end - self.times[0] < LEAST_S:
            return
        self.fitted = end
        every = len(self.times) // POINTS + 1
        times = np.array(self.times[::-every]) - end
        places = np.array(self.places[::-every])
        trust = np.exp(times / WINDOW_S)[:, None]
        scan = PERIODS_S[-times[-1] / 1.15 > PERIODS_S]
        if self.period_s:
            scan = np.concatenate([scan, self.period_s * np.linspace(0.97, 1.03, 13)])
        tried = []
        for period in scan.tolist():
            waves = _waves(times, period)
            weights = np.linalg.lstsq(trust * waves, trust * places, rcond=1e-4)[0]
            tried.append((float((trust * (waves @ weights - places) ** 2).sum()), period, weights))
        if not tried:
            return
        least = min(left for left, _, _ in tried)
        shortest = min(period for left, period, _ in tried if left <= AS_GOOD * least + 1e-9)
        near = [one for one in tried if one[1] <= 1.1 * shortest]
        _, self.period_s, best = min(near, key=lambda one: one[0])
        self.weights = best.tolist()
        self.missed = (0.0, 0.0)

    def _curve(self, t: float) -> Pair:
        assert self.period_s is not None
        x, y = (_waves(np.array([t - self.fitted]), self.period_s) @ np.array(self.weights))[0]
        return float(x), float(y)


@dataclass
class Bank:
    """Predictors, their past errors, and the choice."""

    movers: list[Mover]
    harmonic: Harmonic | None = None
    chosen: int = 0
    """Number of the one that is believed; the harmonic one comes last."""
    errors: list[float] = field(default_factory=list)
    """Mean squared error of each [rad2]."""
    judged: list[int] = field(default_factory=list)
    """How often each was."""
    wait: int = SURE
    """So often they must have been before there is a choice."""
    said: list[tuple[float, list[Pair | None]]] = field(default_factory=list)
    """What each said, with the time that it said it of."""
    t: float | None = None
    """Of the newest place [s]."""

    def update(self, t: float, seen: Pair, variance: float, horizon_s: float) -> None:
        """Take in one place; judge what was said of this time, say something of a later one.

        Args:
            t: when the target was there [s].
            seen: place [rad].
            variance: of each coordinate [rad2].
            horizon_s: how far ahead predictions are wanted [s].
        """
        count = len(self.all_at(t))
        self.errors, self.judged = self.errors or [1.0] * count, self.judged or [0] * count
        share = 1.0 if self.t is None else min(1.0, max(0.0, t - self.t) / MEMORY_S)
        self.t = t
        while self.said and self.said[0][0] <= t + 1e-6:
            when, places = self.said.pop(0)
            if t - when > 0.06:  # frames were lost since: nothing to compare with
                continue
            for n, place in enumerate(places):
                if place is not None:
                    squared = (place[0] - seen[0]) ** 2 + (place[1] - seen[1]) ** 2
                    self.judged[n] += 1
                    weight = max(share, 1 / self.judged[n])  # a plain mean at first
                    self.errors[n] += weight * (squared - self.errors[n])
        for one in self.movers:
            one.update(t, seen, variance)
        if self.harmonic:
            self.harmonic.update(t, seen)
        self.said.append((t + horizon_s, self.all_at(t + horizon_s)))
        best = int(np.argmin(self.errors))
        if self.judged[best] < self.wait:
            return
        if self.errors[best] < CLEARLY * self.errors[self.chosen]:
            self.chosen = best

    def forget(self, wait: int) -> None:
        """Leave the choice as it is until each was judged so often anew."""
        self.judged, self.wait = [], wait

    def rewrite(self, times: list[float], places: list[Pair], variance: float) -> None:
        """Replace the past: the same frames, as a better model of the tip tells them."""
        self.said = []  # by another model
        for one in self.movers:
            one.t = None
            for t, place in zip(times[-RECENT:], places[-RECENT:], strict=True):
                one.update(t, place, variance)
        if self.harmonic and times:
            self.harmonic.times, self.harmonic.places = list(times), list(places)
            self.harmonic.fit()

    def all_at(self, t: float) -> list[Pair | None]:
        """What each predictor says of a time; None where it cannot tell yet."""
        last = [self.harmonic.at(t)] if self.harmonic else []
        return [*(one.at(t) for one in self.movers), *last]

    def at(self, t: float) -> Pair:
        """What the chosen one says."""
        place = self.all_at(t)[self.chosen]
        return self.movers[0].at(t) if place is None else place


def _waves(times: Vector, period: float) -> Vector:
    phase = 2 * np.pi / period * np.outer(times, np.arange(1, OVERTONES + 1))
    return np.concatenate([np.ones((len(times), 1)), np.cos(phase), np.sin(phase)], axis=1)
