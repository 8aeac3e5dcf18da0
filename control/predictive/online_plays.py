"""Identification of hysteresis while the lock runs: windowed least squares, target as nuisance.

A frame shows the target's offset from the axis at its exposure t_k: d_k, in bend angles. With plays
p_i of the measured handle angle and their weights w_i, the target was at

    a_k = sum_i w_i p_i(t_k) + d_k.

The target moves smoothly, a = B c with cubic splines B; what is not smooth must be hysteresis:

    min |(1 - Q Q')(P w + d)|^2 + n ridge |w - w0|^2 + n slope_ridge (sum w - sum w0)^2,   w >= 0,

with Q an orthonormal basis of B. If the handle moves smoothly too, the sum of the weights cannot be
separated from the target's motion, so it is held near the prior. The weights w0 are those of the
likeliest single play, whose evidence tells whether to believe in any of this
(control/predictive/loop_evidence.py). The video's latency is found by evaluating P slightly earlier
and later.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from endolock.control.predictive import loop_evidence
from endolock.control.predictive.handle_history import COLUMNS, HALF_WIDTHS, PLAYS, HandleHistory
from endolock.control.predictive.loop_evidence import ALIKE, LoopEvidence
from endolock.control.transmission.linear_process import BEND_PER_HANDLE
from endolock.hw.api import Vector

KNOT_S = 0.8
"""Spacing of the spline's knots [s]: faster motion of the target counts as hysteresis.
Assumed."""
RIDGE, SLOPE_RIDGE = 2e-5, 1e-3
"""Weights of the prior. Source: tuned on the default instrument."""
EXCITED_RAD = 0.15
"""Motion within the window below which an axis is not identified [rad]."""
SHIFTS_S = (-0.04, -0.02, 0.0, 0.02, 0.04)
"""Changes of the shift that are tried each time [s]."""


class IdentifiedAxis(NamedTuple):
    """Weights of one axis, and what speaks for them."""

    weights: Vector
    """Weights of the columns, `COLUMNS` [rad/rad]."""
    width_std: float
    """Standard deviation of the mean width, sum w 2r / sum w [rad]."""
    misfit: float
    """Mean squared residual [rad2]."""
    loop: LoopEvidence
    """Evidence of a loop."""
    free: Vector
    """What is not smooth in the columns, n x k [rad]."""
    rest: Vector
    """What is not smooth in the bend, n [rad]."""

    def allows(self, weights: Vector, odds: float) -> bool:
        """Whether other weights, `COLUMNS` [rad/rad], are possible up to some odds [1]."""
        k = self.free.shape[1]
        return loop_evidence.possible(self.free, self.rest, weights[:k], self.loop, odds=odds)


class IdentifiedPlays(NamedTuple):
    """Both axes and the latency, identified from one window."""

    shift_s: float
    """Delay of the exposures relative to their believed times [s]; the latency is less by it."""
    shift_std_s: float
    """Standard deviation of the shift [s]."""
    surer: float
    """How much less likely the present shift is [1]."""
    axes: tuple[IdentifiedAxis | None, IdentifiedAxis | None]
    """Each axis; None where the handle did not move."""


def identify(
    t: Vector, seen: Vector, history: HandleHistory, shift: float, *, dead_zones: bool
) -> IdentifiedPlays | None:
    """Identify weights and latency.

    Args:
        t: believed exposure times of the frames, n [s].
        seen: offsets of the target in them, n x 2 [rad].
        history: handle angles of the past.
        shift: present shift of the exposures [s].
        dead_zones: whether slack is looked for.

    Returns:
        The result; None if neither handle moved.
    """
    basis, _ = np.linalg.qr(splines(t))
    rough = seen - basis @ (basis.T @ seen)
    k = COLUMNS if dead_zones else PLAYS
    tried: list[tuple[IdentifiedAxis | None, IdentifiedAxis | None]] = []
    for change in SHIFTS_S:
        columns = history.columns_at(t + shift + change)[:, :, :k]
        moved = np.ptp(columns[:, :, 0], axis=0) > EXCITED_RAD
        first, second = (
            _fit(columns[:, axis] - basis @ (basis.T @ columns[:, axis]), -rough[:, axis])
            if moved[axis]
            else None
            for axis in range(2)
        )
        tried.append((first, second))
    left = [sum(one.misfit for one in axes if one) for axes in tried]
    best = int(np.argmin(left))
    if not any(tried[best]):
        return None
    middle = min(max(best, 1), len(tried) - 2)
    step = SHIFTS_S[1] - SHIFTS_S[0]
    bend = (left[middle - 1] - 2 * left[middle] + left[middle + 1]) / step**2
    shift_std = float(np.sqrt(2 * ALIKE * left[best] / (len(t) * bend))) if bend > 0 else step
    surer = loop_evidence.less_likely(left[len(left) // 2], left[best], len(t))
    return IdentifiedPlays(shift + SHIFTS_S[best], shift_std, surer, tried[best])


def _fit(free: Vector, rest: Vector) -> IdentifiedAxis:
    """Identify the weights of one axis.

    Args:
        free: what is not smooth in the columns, n x k [rad].
        rest: what is not smooth in the bend, n [rad].
    """
    from scipy.optimize import nnls  # see increment_fit.prepare

    count = len(rest)
    loop = loop_evidence.weigh(free, rest, BEND_PER_HANDLE)
    k = PLAYS if loop.likeliest < PLAYS else free.shape[1]
    some = free[:, :k]
    prior = np.zeros(k)
    prior[loop.likeliest] = BEND_PER_HANDLE
    gram = some.T @ some + count * (RIDGE * np.eye(k) + SLOPE_RIDGE)
    root = np.linalg.cholesky(gram)
    aim = some.T @ rest + count * (RIDGE * prior + SLOPE_RIDGE * BEND_PER_HANDLE)
    weights = np.zeros(COLUMNS)
    weights[:k] = nnls(root.T, np.linalg.solve(root, aim))[0]
    misfit = float(np.mean((some @ weights[:k] - rest) ** 2))
    total = max(float(weights.sum()), 1e-6)  # 0 where the tip seems to turn the wrong way
    gradient = 2 * (HALF_WIDTHS[:k] - (weights @ HALF_WIDTHS) / total) / total
    # The errors of neighbouring frames are alike: about one in every other knot is independent.
    spread = np.sqrt(ALIKE * misfit) * np.linalg.norm(np.linalg.solve(root, gradient))
    return IdentifiedAxis(weights, float(spread), misfit, loop, free, rest)


def splines(t: Vector, knot_s: float = KNOT_S) -> Vector:
    """Values of cubic B-splines with even knots over the range of the times, n x m."""
    first = float(t[0])
    count = int(np.ceil((float(t[-1]) - first) / knot_s)) + 3
    u = np.abs((t[:, None] - first) / knot_s - np.arange(count)[None] + 1.0)
    near, far = 2 / 3 - u**2 + u**3 / 2, np.maximum(2 - u, 0) ** 3 / 6
    basis: Vector = np.where(u < 1, near, far)
    return basis
