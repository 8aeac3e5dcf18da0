"""Blend of several predictions of one axis by their errors out of sample.

Every prediction is kept and compared with what was measured later. With C the mean products of the
errors, which decay, the weights minimise w' C w over w >= 0, sum w = 1; a ridge keeps equally good
predictors together, and one that was compared a few times only counts as worse than it was. The
first predictor says that the target stays. The others move it only as far as that helped recently:

    y = stays + g (w' x - stays),  g = mean((w' x - stays)(measured - stays)) / mean((...)^2)

between 0 and 1, so that the blend falls back to it where prediction does not help.

Reference:
    J. M. Bates and C. W. J. Granger, The combination of forecasts, Operational Research Quarterly
    20(4), 1969.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, sqrt

import numpy as np

MEMORY_S = 6.0
"""Time constant with which errors decay [s]. Assumed: one or two turns of the target."""
ERROR_MEMORY_S = 3.0
"""Time constant of the expected error [s]. Assumed: shorter, to follow what is being learnt."""
LEAST = 10
"""Number of comparisons before a predictor is used: 0.4 s."""
NEW = 5.0
"""Number of comparisons at which the error counts twice [1]: short records are lucky ones."""
RIDGE = 0.05
"""Part of each mean squared error that is added as if it was independent [1]. Assumed."""


class PredictionBlend:
    """Errors and weights of the predictors of one axis.

    Args:
        count: number of predictors; the first says that the target stays.
        start_rad: expected error before the first comparison [rad].
    """

    def __init__(self, count: int, start_rad: float) -> None:
        self.shares = [1.0] + [0.0] * (count - 1)
        """Share of each predictor in the blend, of sum 1."""
        self._sums = np.zeros((2, count, count))  # products of errors, and how many there were
        self._helped = self._tried = 0.0
        self._missed, self._judged = start_rad**2, 0.0
        self._variance = 0.0
        self._raw = [1.0] + [0.0] * (count - 1)

    @property
    def error_rad(self) -> float:
        """Expected rms error of the blend at the horizon, without that of the measurement [rad]."""
        least = 0.05 * self._missed  # an estimate of the noise is not exact
        return sqrt(max(self._missed - self._variance, least))

    def blended(self, predictions: Sequence[float | None]) -> float:
        """Blend predictions [rad]; one that is missing counts as the first."""
        return _moved(self.shares, predictions)

    def raw(self, predictions: Sequence[float | None]) -> float:
        """Blend predictions with g = 1 [rad]."""
        return _moved(self._raw, predictions)

    def fade(self, dt: float) -> None:
        """Let all errors decay over a time [s]."""
        keep = exp(-dt / MEMORY_S)
        self._sums *= keep
        self._helped *= keep
        self._tried *= keep
        self._judged *= exp(-dt / ERROR_MEMORY_S)

    def judge(
        self, said: Sequence[float | None], blended: float, raw: float, seen: float, variance: float
    ) -> None:
        """Compare earlier predictions with what was measured at the time that they were for.

        Args:
            said: prediction of each [rad]; None where there was none.
            blended: what `blended` gave then [rad].
            raw: what `raw` gave then [rad].
            seen: measured place [rad].
            variance: its variance [rad2].
        """
        stays = said[0]
        assert stays is not None
        errors = [0.0 if x is None else x - seen for x in said]
        both = np.array([errors, [0.0 if x is None else 1.0 for x in said]])
        self._sums += both[:, :, None] * both[:, None, :]
        self._helped += (raw - stays) * (seen - stays)
        self._tried += (raw - stays) ** 2
        self._judged += 1
        part = 1 / self._judged
        self._missed += part * ((blended - seen) ** 2 - self._missed)
        self._variance += part * (variance - self._variance)

    def weigh(self, present: Sequence[bool]) -> None:
        """Choose the shares, of predictors that predict at present."""
        sums, counts = self._sums.tolist()
        usable = [n for n, known in enumerate(present) if known and counts[n][n] >= LEAST]
        raw = [0.0] * len(present)
        if not usable or usable[0] != 0 or len(usable) == 1:
            raw[0] = 1.0
        else:
            products = [[sums[n][m] / max(counts[n][m], 1e-9) for m in usable] for n in usable]
            for at, n in enumerate(usable):
                doubt = RIDGE + (NEW / counts[n][n] if n else 0.0)
                products[at][at] += doubt * products[at][at] + 1e-14
            for n, share in zip(usable, _least(products), strict=True):
                raw[n] = share
        gain = min(max(self._helped / self._tried, 0.0), 1.0) if self._tried > 0 else 1.0
        shares = [gain * share for share in raw]
        shares[0] += 1 - gain
        self.shares, self._raw = shares, raw


def _moved(shares: Sequence[float], predictions: Sequence[float | None]) -> float:
    stays = predictions[0]
    assert stays is not None
    found = stays
    for share, prediction in zip(shares, predictions, strict=True):
        if share and prediction is not None:
            found += share * (prediction - stays)
    return found


def _least(products: list[list[float]]) -> list[float]:
    """Weights >= 0 of sum 1 that minimise w' C w: negative ones are left out, one round each."""
    left = list(range(len(products)))
    while True:
        found = _solved([[products[n][m] for m in left] for n in left])
        total = sum(found)
        found = [share / total for share in found]
        if min(found) >= 0 or len(left) == 1:
            break
        left = [n for n, share in zip(left, found, strict=True) if share > 0]
    weights = [0.0] * len(products)
    for n, share in zip(left, found, strict=True):
        weights[n] = share
    return weights


def _solved(matrix: list[list[float]]) -> list[float]:
    """Solution of C w = 1 for a positive definite C, which is overwritten.

    By elimination in plain numbers: for so few, arrays take longer.
    """
    count = len(matrix)
    right = [1.0] * count
    for n in range(count):
        row, pivot = matrix[n], matrix[n][n]
        for m in range(n + 1, count):
            lower = matrix[m]
            factor = lower[n] / pivot
            right[m] -= factor * right[n]
            for k in range(n + 1, count):
                lower[k] -= factor * row[k]
    for n in reversed(range(count)):
        for k in range(n + 1, count):
            right[n] -= matrix[n][k] * right[k]
        right[n] /= matrix[n][n]
    return right
