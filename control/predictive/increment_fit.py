"""Weights of the transmission from increments of the bend, by regression.

The background tells how the tip has turned between two frames: an increment y of the bend, for an
increment x of the columns of control/predictive/handle_history.py. Both are summed with a memory of
`LEAK_S`, so that the drift of the sums is forgotten while slow motion still counts, and

    min over w >= 0:  |y - X w|^2 / (n s^2) + |w - w0|^2 / a^2 + (sum w - sum w0)^2 / b^2
                      + 2 k sum r w,

with s^2 the larger of noise and residual, n the number of frames over which a sum is correlated,
and r the half-width of a column: with little evidence loops stay narrow. X'X, X'y and y'y are kept
with a memory of `KEEP_S` for several delays of the video; the delay is where the residual is least.
So is the rotation of the video about its optical axis, by which y is turned into axes of the wires.

Reference:
    C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974, ch. 23 (non-negative
    weights).
"""

from __future__ import annotations

from math import exp, sqrt
from typing import NamedTuple

import numpy as np

from endolock.control.predictive.capstan_model import rotation
from endolock.control.predictive.handle_history import COLUMNS, HALF_WIDTHS, PLAYS, PRIOR
from endolock.hw.api import Vector

SHIFTS_S = np.array([-0.16, -0.12, -0.08, -0.04, 0.0, 0.04, 0.08, 0.12, 0.16])
"""Delays of the exposures relative to their believed times that are compared [s]."""
LEAK_S, KEEP_S = 1.0, 30.0
"""Time constants of the sums and of the evidence [s]. Assumed."""
CLEARLY = 0.85
"""Ratio of squared residuals below which another delay is better [1]: what columns cannot explain
may look like a small one. Assumed."""
TURN_STD_RAD, TURN_STEP_RAD, MOST_TURN_RAD = 0.1, 0.04, 0.3
"""Standard deviation of the video's rotation, distance of the angles that are compared, and largest
angle [rad]. Assumed, as that of the capstan search."""
WEIGHT_STD, SLOPE_STD, WIDTH_PRICE = 0.4, 0.15, 30.0
"""a and b [rad/rad], and k [1/rad]. Assumed: slopes differ by 15 % between instruments."""
_PRECISION = np.eye(COLUMNS) / WEIGHT_STD**2 + 1 / SLOPE_STD**2
_PULL = PRIOR / WEIGHT_STD**2 + PRIOR.sum() / SLOPE_STD**2 - WIDTH_PRICE * HALF_WIDTHS


class FittedAxis(NamedTuple):
    """Weights of one axis and what is known of them."""

    weights: Vector
    """Of each column, >= 0 [rad/rad]."""
    residual: float
    """Variance of the sums that the weights do not explain [rad2]."""
    width_std: float
    """Standard deviation of the mean loop width, sum w 2r / sum w [rad]."""


class IncrementFit:
    """Evidence of both axes, for every delay."""

    def __init__(self) -> None:
        count = len(SHIFTS_S)
        self._x = np.zeros((count, 2, COLUMNS))
        self._y = np.zeros(2)
        self._y_noise = np.zeros(2)
        self._xx = np.zeros((count, 2, COLUMNS, COLUMNS))
        self._xy = np.zeros((count, 2, COLUMNS, 2))
        self._yy = np.zeros((2, 2))
        self._noise = np.zeros(2)
        self.count = 0.0
        """Number of frames that count."""
        self._dt = 0.04
        self._left = np.full(count, np.inf)
        self._left_turned = np.full(3, np.inf)
        self._next = self._next_turn = 0

    @property
    def independent(self) -> float:
        """Number of frames over the number that their sums are correlated for."""
        return self.count * self._dt / LEAK_S

    def add(self, columns: Vector, bend: Vector, variance: Vector, dt: float) -> None:
        """Add one increment.

        Args:
            columns: increments of the columns for each delay, `SHIFTS_S` x 2 x `COLUMNS` [rad].
            bend: increments of the bends, in axes of the video, 2 [rad].
            variance: their variances, 2 [rad2].
            dt: time between the frames [s].
        """
        leak, keep = exp(-dt / LEAK_S), exp(-dt / KEEP_S)
        self._dt += 0.1 * (dt - self._dt)
        self._x = leak * self._x + columns
        self._y = leak * self._y + bend
        self._y_noise = leak**2 * self._y_noise + variance
        self._xx *= keep
        self._xx += self._x[..., None] * self._x[..., None, :]
        self._xy *= keep
        self._xy += self._x[..., None] * self._y
        self._yy = keep * self._yy + np.outer(self._y, self._y)
        self._noise = keep * self._noise + self._y_noise
        self.count = keep * self.count + 1

    def discount(self, factor: float) -> None:
        """Let the evidence so far count less, by a factor below 1."""
        for array in (self._xx, self._xy, self._yy, self._noise):
            array *= factor
        self.count *= factor
        self._left[:] = self._left_turned[:] = np.inf

    def solve(self, axis: int, shift: float, dead_zones: bool, turn: float = 0.0) -> FittedAxis:
        """Fit the weights of an axis.

        Args:
            axis: 0 or 1.
            shift: delay of the exposures [s].
            dead_zones: whether dead zones may have weights.
            turn: rotation of the video about its optical axis, from its axes to the wires' [rad].
        """
        weights, residual, curvature = self._solve(axis, shift, dead_zones, turn)
        half = HALF_WIDTHS[: len(weights)]
        slope = max(float(weights.sum()), 1e-6)
        gradient = 2 * (half - (weights @ half) / slope) / slope
        spread = float(gradient @ np.linalg.solve(curvature, gradient))
        full = np.zeros(COLUMNS)
        full[: len(weights)] = weights
        return FittedAxis(full, residual, sqrt(max(spread, 0.0)))

    def _solve(
        self, axis: int, shift: float, dead_zones: bool, turn: float
    ) -> tuple[Vector, float, Vector]:
        """Weights, variance that they do not explain, and half the curvature of the criterion."""
        from scipy.optimize import nnls  # see prepare

        count = max(self.count, 1.0)
        low = min(max(int(np.searchsorted(SHIFTS_S, shift)) - 1, 0), len(SHIFTS_S) - 2)
        below, above = SHIFTS_S[low : low + 2].tolist()
        part = min(max((shift - below) / (above - below), 0.0), 1.0)
        k = COLUMNS if dead_zones else PLAYS
        xx = ((1 - part) * self._xx[low, axis] + part * self._xx[low + 1, axis])[:k, :k]
        along = rotation(turn)[axis]
        xy = ((1 - part) * self._xy[low, axis] + part * self._xy[low + 1, axis])[:k] @ along
        yy, noise = float(along @ self._yy @ along), float(along**2 @ self._noise) / count
        variance = max(noise, 1e-7)
        for _ in range(2):
            scale = variance * LEAK_S / self._dt
            a = xx / scale + _PRECISION[:k, :k]
            b = xy / scale + _PULL[:k]
            root = np.linalg.cholesky(a)
            weights, _ = nnls(root.T, np.linalg.solve(root, b))
            residual = max(float(yy + weights @ (xx @ weights - 2 * xy)), 0.0) / count
            variance = max(noise, residual, 1e-7)
        return np.asarray(weights), residual, a

    def look_for_delay(self, dead_zones: bool, turn: float) -> None:
        """Fit both axes with one of the delays of `SHIFTS_S`, the next at each call."""
        n = self._next = (self._next + 1) % len(SHIFTS_S)
        self._left[n] = self._residual(float(SHIFTS_S[n]), dead_zones, turn)

    def look_for_turn(self, shift: float, dead_zones: bool, turn: float) -> float:
        """Fit both axes with one of three rotations, the next at each call.

        Return the best rotation, after the last of them, or else the present one [rad].
        """
        n = self._next_turn = (self._next_turn + 1) % 3
        tried = turn + (n - 1) * TURN_STEP_RAD
        left = self._residual(shift, dead_zones, tried)
        price = LEAK_S / self._dt / max(self.count, 1.0) / TURN_STD_RAD**2
        least = float(self._noise.sum()) / max(self.count, 1.0)
        self._left_turned[n] = left + price * max(left, least) * tried**2
        below, middle, above = self._left_turned.tolist()
        if n != 2 or not np.isfinite(below + middle + above):
            return turn
        curved = below - 2 * middle + above
        step = 0.5 * (below - above) / curved if curved > 0 else np.sign(below - above)
        step = float(np.clip(step, -1, 1)) * TURN_STEP_RAD
        return float(np.clip(turn + step, -MOST_TURN_RAD, MOST_TURN_RAD))

    def _residual(self, shift: float, dead_zones: bool, turn: float) -> float:
        """Residual of both axes [rad2]."""
        return sum(self._solve(axis, shift, dead_zones, turn)[1] for axis in range(2))

    def delay(self, shift: float) -> tuple[float, float] | None:
        """Delay of the exposures with the least residual, and its standard deviation [s].

        The weights are fitted for each delay (`look_for_delay`), as loops that are too narrow look
        like a delay. From a parabola through the three least; None if it opens downwards, before
        all were looked at, or if the least residual is not clearly below that of the present delay.

        Args:
            shift: present delay [s].
        """
        left = self._left
        if not np.isfinite(left).all():
            return None
        best = int(np.clip(np.argmin(left), 1, len(SHIFTS_S) - 2))
        below, least, above = left[best - 1 : best + 2]
        curved = below - 2 * least + above
        if curved <= 0:
            return None
        if least > CLEARLY * np.interp(shift, SHIFTS_S, left):
            return None
        spacing = float(SHIFTS_S[1] - SHIFTS_S[0])
        step = float(np.clip(0.5 * (below - above) / curved, -1, 1))
        spread = 2 * least / (curved * max(self.independent, 1.0))
        return float(SHIFTS_S[best]) + step * spacing, float(np.sqrt(spread)) * spacing

    def moved(self, axis: int) -> float:
        """Variance of the sums of the handle's motion [rad2]."""
        return float(self._xx[len(SHIFTS_S) // 2, axis, 0, 0]) / max(self.count, 1.0)

    def turned(self, axis: int) -> float:
        """Variance of the sums of the bend, in axes of the video [rad2]."""
        return float(self._yy[axis, axis]) / max(self.count, 1.0)


def prepare() -> None:
    """Load what fits of weights need, which takes half a second, too long for a tick."""
    import scipy.optimize  # noqa: F401
