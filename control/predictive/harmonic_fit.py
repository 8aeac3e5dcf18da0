"""Periodic curves, a mean and a few harmonics, fitted to the past of a target.

Of the places x at the times t, newer ones count more. With W the roots of their weights,

    min over w:  |W (x - B w)|^2 + ridge |w|^2,    B = 1, cos k 2 pi t / T, sin k 2 pi t / T, ...

is solved for many periods T at once, or for one period that is refined by Gauss-Newton.
"""

from __future__ import annotations

from math import pi

import numpy as np

from endolock.control.predictive.place_history import WINDOW_S, PlaceHistory
from endolock.hw.api import Vector

OVERTONES = 3
"""Number of harmonics, the fundamental included."""
POINTS = 200
"""Largest number of places fitted; of more, every second, third, ... is used."""
RIDGE = 1e-6
"""Ridge, in the sum of the weights [1]: overtones that the past cannot tell apart stay small."""
FASTEST = 0.03
"""Largest change of a period in one refinement [1]. Assumed: less than between candidates."""
_SAME = np.eye(1 + 2 * OVERTONES)
_ORDERS = np.arange(1, OVERTONES + 1)


class Sample:
    """Places that are fitted, and how much each of them counts.

    Args:
        past: all places.
        every: spacing of the places [1], twice that where there are more than `POINTS`, and so on.
    """

    def __init__(self, past: PlaceHistory, every: int = 1) -> None:
        every *= len(past.times) // POINTS + 1
        newest_first = slice(None, None, -every)
        times = past.times[newest_first][::-1]
        self.times = times - past.times[-1]
        """Relative to the newest [s]."""
        trust = np.exp(2 * self.times / WINDOW_S)  # the start is forgotten
        trust /= trust.sum()
        self.root = np.sqrt(trust)
        """Square root of the weight of each place, which are of sum 1."""
        places = past.places[:, newest_first][:, ::-1]
        self.middle = places @ trust
        """Mean on each axis [rad]."""
        self.places = (places - self.middle[:, None]) * self.root
        """Distance from the mean, by that root, one row per axis [rad]."""
        self.squares = (self.places**2).sum(axis=1)
        """Variance on each axis [rad2]."""
        self.length_s = -float(self.times[0])
        """Length of the past [s]."""


def _waves(sample: Sample, periods: Vector) -> Vector:
    """1, cosines and sines of every period, by the root weights, (periods, 1 + 2 OVERTONES, n)."""
    phases = 2 * pi / periods[:, None] * sample.times
    waves = np.empty((len(periods), 1 + 2 * OVERTONES, len(sample.times)))
    cosines = np.cos(phases)
    waves[:, 0] = sample.root
    np.multiply(cosines, sample.root, out=waves[:, 1])
    np.multiply(np.sin(phases), sample.root, out=waves[:, 2])
    twice = 2 * cosines[:, None]
    for k in range(3, 2 * OVERTONES, 2):  # cos (k+1)x = 2 cos x cos kx - cos (k-1)x, sin alike
        np.multiply(twice, waves[:, k - 2 : k], out=waves[:, k : k + 2])
        if k == 3:
            waves[:, 3] -= sample.root
        else:
            waves[:, k : k + 2] -= waves[:, k - 4 : k - 2]
    return waves


def residuals_of(sample: Sample, periods: Vector) -> Vector:
    """Weighted mean squares that each period leaves on each axis, (periods, 2)."""
    waves = _waves(sample, periods)
    gram = waves @ waves.swapaxes(1, 2) + RIDGE * _SAME
    moments = waves @ sample.places.T
    left: Vector = sample.squares - (moments * np.linalg.solve(gram, moments)).sum(axis=1)
    return np.maximum(left, 0.0)


def refined(sample: Sample, axis: int, period: float, steps: int) -> tuple[float, Vector, float]:
    """Refine a period by Gauss-Newton; return it, the weights, and the mean square left."""
    places = sample.places[axis]
    for step in range(steps + 1):
        waves = _waves(sample, np.array([period]))[0]
        gram = waves @ waves.T + RIDGE * _SAME
        weights = np.linalg.solve(gram, waves @ places)
        off = places - weights @ waves
        if step == steps:
            break
        # d/dlog(period) of cos(k w t) is k w t sin(k w t); the waves are projected out of it.
        swing = (_ORDERS * weights[1::2]) @ waves[2::2] - (_ORDERS * weights[2::2]) @ waves[1::2]
        slope = 2 * pi / period * sample.times * swing
        slope -= np.linalg.solve(gram, waves @ slope) @ waves
        steep = float(slope @ slope)
        if steep > 0:
            by = float(slope @ off) / steep
            period *= 1 + min(max(by, -FASTEST), FASTEST)
    weights[0] += sample.middle[axis]
    return period, weights, float(off @ off)
