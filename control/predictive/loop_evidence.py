"""Evidence of the loop of one axis, from frames of a target that moves smoothly.

A few seconds do not tell the weights of many columns (control/predictive/handle_history.py), but
they tell which one explains most. A single column, with its best slope, leaves a mean squared
residual E that is not smooth. Compared with the best one, it is less likely by

    L = n / 40 ln((E + e) / (E_best + e)),

with n frames, of which one in 40 is independent, and the least residual e; slack is unusual, and
less likely beforehand. A loop is evident where no loop at all is much less likely, and where all
columns that are about as likely are alike in width. Widths that the handle has not yet gone through
are all alike, so that none of them is known.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from endolock.control.predictive.handle_history import HALF_WIDTHS, PLAYS, SLACKS
from endolock.hw.api import Vector

ALIKE = 40.0
"""Number of neighbouring frames whose errors are alike [1]. Assumed: two knots of the splines."""
SLOPES, SLOPE_RIDGE = (0.6, 1.4), 1e-3
"""Range of the slope relative to the prior's, and weight of the prior's slope. Assumed."""
LEAST_RAD2 = 2e-7
"""Residual below which widths are not compared [rad2]. Assumed: 0.2 px at 12 cm, about the noise of
markers."""
CLEARLY, NEARLY = 5.0, 2.0
"""L from which a model is out of the question, and up to which one is possible [1]: odds of 150,
and two standard deviations."""
BEYOND_DOUBT = 15.0
"""L from which loops are out of the question [1]. Assumed: three times as much as for a loop, which
is what is to be expected, and which a target that is followed may hide."""
UNUSUAL = 2.0
"""L of slack without any evidence [1]. Assumed: a play that started amid its loop looks the same
until the handle turns back."""
ALIKE_RAD = 0.3
"""Spread of the possible widths up to which the width is known [rad]. Assumed: half a loop."""


class LoopEvidence(NamedTuple):
    """What the frames tell of the loop of one axis."""

    likeliest: int
    """Index of the likeliest column."""
    slope: float
    """Its slope [rad/rad]."""
    left: float
    """Mean squared residual that it leaves [rad2]."""
    lowest: float
    """Least width that is possible [rad]."""
    highest: float
    """Largest width that is possible [rad]; infinite if the widest is."""
    gain: float
    """How much less likely no loop at all is [1]."""
    without: float
    """How much less likely any loop from `ALIKE_RAD` on is [1]."""

    @property
    def evident(self) -> bool:
        """Whether the width is known: that of a loop, or beyond doubt that there is none."""
        known = self.highest - self.lowest <= ALIKE_RAD
        return known and (self.gain > CLEARLY or self.without > BEYOND_DOUBT)


def weigh(free: Vector, rest: Vector, slope: float) -> LoopEvidence:
    """Compare single columns.

    Args:
        free: what is not smooth in the columns, n x k [rad]: the plain plays, or all.
        rest: what is not smooth in the bend, n [rad].
        slope: prior of the slope [rad/rad].
    """
    count, k = free.shape
    power, match = np.einsum("nk,nk->k", free, free), free.T @ rest
    slopes = (match + SLOPE_RIDGE * count * slope) / (power + SLOPE_RIDGE * count)
    slopes = np.minimum(np.maximum(slopes, SLOPES[0] * slope), SLOPES[1] * slope)
    left = np.maximum((slopes**2 * power - 2 * slopes * match + rest @ rest) / count, 0.0)
    less = _likelihood(left, count) + np.where(SLACKS[:k] > 0, UNUSUAL, 0.0)
    best = int(np.argmin(less))
    less = less - less[best]
    widths = 2 * HALF_WIDTHS[:k]
    possible = widths[less < NEARLY]
    widest = float(possible.max()) if less[PLAYS - 1] >= NEARLY else float("inf")
    return LoopEvidence(
        best,
        float(slopes[best]),
        float(left[best]),
        float(possible.min()),
        widest,
        float(less[0]),
        float(less[widths > ALIKE_RAD - 1e-9].min()),
    )


def possible(
    free: Vector, rest: Vector, weights: Vector, evidence: LoopEvidence, *, odds: float
) -> bool:
    """Whether other weights are possible as well.

    Args:
        free: what is not smooth in the columns, n x k [rad].
        rest: what is not smooth in the bend, n [rad].
        weights: weights of the columns, k [rad/rad].
        evidence: what the same frames tell of the loop.
        odds: L up to which they are [1].
    """
    left = float(np.mean((free @ weights - rest) ** 2))
    return less_likely(left, evidence.left, len(rest)) < odds


def less_likely(left: float, best: float, count: int) -> float:
    """L of a mean squared residual compared with another [rad2], of so many frames."""
    both = _likelihood(np.array([left, best]), count)
    return float(both[0] - both[1])


def _likelihood(left: Vector, count: int) -> Vector:
    """Negative logarithm of the likelihood of mean squared residuals, up to a constant."""
    found: Vector = count / ALIKE * np.log(left + LEAST_RAD2)
    return found
