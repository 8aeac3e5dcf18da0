"""Identification of hysteresis while the lock runs: windowed least squares, target as nuisance.

A frame shows the target's offset from the axis at its exposure t_k: d_k, in bend angles. With plays
p_i of the measured handle angle and their weights w_i, the target was at

    a_k = sum_i w_i p_i(t_k) + d_k.

The target moves smoothly, a = B c with cubic splines B; what is not smooth must be hysteresis:

    min |(1 - Q Q')(P w + d)|^2 + n ridge |w - w0|^2 + n slope_ridge (sum w - sum w0)^2,   w >= 0,

with Q an orthonormal basis of B. If the handle moves smoothly too, the sum of the weights cannot be
separated from the target's motion, so it is held near the prior. The video's latency is found by
evaluating P slightly earlier and later.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from endolock.hw.api import Vector

KNOT_S = 0.8
"""Spacing of the spline's knots [s]: faster motion of the target counts as hysteresis.
Assumed."""
ALIKE = 40.0
"""Number of neighbouring frames whose errors are alike [1]. Assumed: two knots."""
RIDGE, SLOPE_RIDGE = 2e-5, 1e-3
"""Weights of the prior. Source: tuned on the default instrument."""
WINDOW_S = 25.0
"""Length of the window [s]."""
EXCITED_RAD = 0.15
"""Motion within the window below which an axis is not identified [rad]."""
SHIFTS_S = (-0.04, -0.02, 0.0, 0.02, 0.04)
"""Changes of the shift that are tried each time [s]."""


class IdentifiedPlays(NamedTuple):
    """Weights of both axes and latency, identified from one window."""

    shift_s: float
    """Delay of the exposures relative to their believed times [s]; the latency is less by it."""
    shift_std_s: float
    """Standard deviation of the shift [s]."""
    weights: tuple[Vector | None, Vector | None]
    """Weights of each axis [rad/rad]; None where the handle did not move."""
    width_std: tuple[float, float]
    """Standard deviation of the mean width, sum w 2r / sum w [rad]."""
    misfit_rad: float
    """Residual, rms of both axes together [rad]."""


def prepare() -> None:
    """Load the modules that `identify` needs, which takes half a second, too long for a tick."""
    import scipy.optimize  # noqa: F401


def identify(
    t: Vector,
    seen: Vector,
    times: Vector,
    plays: Vector,
    prior: Vector,
    radii: Vector,
    shift: float,
) -> IdentifiedPlays | None:
    """Identify weights and latency.

    Args:
        t: believed exposure times of the frames, n [s].
        seen: offsets of the target in them, n x 2 [rad].
        times: times of the ticks, m [s].
        plays: outputs of the plays at the ticks, m x 2 x k [rad].
        prior: prior weights, k [rad/rad].
        radii: half-widths of the plays, k [rad].
        shift: present shift of the exposures [s].

    Returns:
        The result; None if neither handle moved.
    """
    basis, _ = np.linalg.qr(splines(t))
    tried = []
    for change in SHIFTS_S:
        exposed = t + shift + change
        total = 0.0
        weights: list[Vector | None] = []
        spread: list[float] = []
        for axis in range(2):
            columns = np.column_stack([np.interp(exposed, times, p) for p in plays[:, axis].T])
            if np.ptp(columns[:, 0]) < EXCITED_RAD:
                weights.append(None)
                spread.append(0.0)
                continue
            w, misfit, covariance = _fit(columns, seen[:, axis], basis, prior)
            slope = w.sum()
            gradient = 2 * (radii - (w @ radii) / slope) / slope
            weights.append(w)
            spread.append(float(np.sqrt(max(gradient @ covariance @ gradient, 0.0))))
            total += misfit
        tried.append((total, shift + change, (weights[0], weights[1]), (spread[0], spread[1])))
    best = min(range(len(tried)), key=lambda n: tried[n][0])
    left, found, weights_of, width_std = tried[best]
    if weights_of[0] is None and weights_of[1] is None:
        return None
    middle = min(max(best, 1), len(tried) - 2)
    step = SHIFTS_S[1] - SHIFTS_S[0]
    bend = (tried[middle - 1][0] - 2 * tried[middle][0] + tried[middle + 1][0]) / step**2
    shift_std = float(np.sqrt(2 * left / (len(t) * bend))) if bend > 0 else step
    return IdentifiedPlays(found, shift_std, weights_of, width_std, float(np.sqrt(left)))


def _fit(
    columns: Vector, seen: Vector, basis: Vector, prior: Vector
) -> tuple[Vector, float, Vector]:
    """Weights of one axis, mean squared residual [rad2], and covariance of the weights."""
    from scipy.optimize import nnls  # see prepare

    count, k = columns.shape
    free = columns - basis @ (basis.T @ columns)
    rest = basis @ (basis.T @ seen) - seen
    pull, whole = np.sqrt(RIDGE * count), np.sqrt(SLOPE_RIDGE * count)
    a = np.concatenate([free, pull * np.eye(k), np.full((1, k), whole)])
    b = np.concatenate([rest, pull * prior, [whole * prior.sum()]])
    weights, _ = nnls(a, b)
    misfit = float(np.mean((free @ weights - rest) ** 2))
    # The errors of neighbouring frames are alike: about one in every other knot is independent.
    return np.asarray(weights), misfit, ALIKE * misfit * np.linalg.inv(a.T @ a)


def splines(t: Vector, knot_s: float = KNOT_S) -> Vector:
    """Values of cubic B-splines with even knots over the range of the times, n x m."""
    first = float(t[0])
    count = int(np.ceil((float(t[-1]) - first) / knot_s)) + 3
    u = np.abs((t[:, None] - first) / knot_s - np.arange(count)[None] + 1.0)
    near, far = 2 / 3 - u**2 + u**3 / 2, np.maximum(2 - u, 0) ** 3 / 6
    basis: Vector = np.where(u < 1, near, far)
    return basis
