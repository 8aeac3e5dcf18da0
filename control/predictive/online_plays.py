"""Identification of hysteresis while the lock runs: windowed least squares, the target a nuisance.

A frame tells by how much the target lay off the axis at its exposure t_k: d_k, in bend angles. With
plays p_i behind the measured handle and their weights w_i, the target's own place was

    a_k = sum_i w_i p_i(t_k) + d_k.

The target moves smoothly, a = B c with cubic splines B; what is not smooth must be hysteresis:

    min |(1 - Q Q')(P w + d)|^2 + n ridge |w - w0|^2 + n slope_ridge (sum w - sum w0)^2,   w >= 0,

with Q an orthonormal basis of B. Where the handle moves smoothly too, the sum of the weights cannot
be told from the target's motion; so it is held near the prior. The video's latency is found by
evaluating P somewhat earlier and later.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from endolock.hw.api import Vector

KNOT_S = 0.8
"""Distance of the spline's knots [s]: the target is taken to be no quicker. Assumed."""
RIDGE, SLOPE_RIDGE = 2e-5, 1e-3
"""Weights of the prior. Source: tuned on the default instrument."""
WINDOW_S = 25.0
"""So much of the past is used [s]."""
EXCITED_RAD = 0.15
"""A handle that moved by less within the window tells nothing [rad]: its prior stays."""
SHIFTS_S = (-0.04, -0.02, 0.0, 0.02, 0.04)
"""Changes of the latency that are tried at once [s]."""


class Found(NamedTuple):
    """What a window tells of both axes."""

    shift_s: float
    """Latency more than believed is minus this [s]."""
    shift_std_s: float
    """[s]"""
    weights: tuple[Vector | None, Vector | None]
    """Of each axis; None where the handle did not move."""
    width_std: tuple[float, float]
    """Standard deviation of the mean width, sum w 2r / sum w [rad]."""
    misfit_rad: float
    """What is left, rms of both axes together [rad]."""


def prepare() -> None:
    """Load what `identify` needs: half a second, which no tick may take."""
    import scipy.optimize  # noqa: F401


def identify(
    t: Vector,
    seen: Vector,
    times: Vector,
    plays: Vector,
    prior: Vector,
    radii: Vector,
    shift: float,
) -> Found | None:
    """Find weights and latency.

    Args:
        t: exposures of the frames, as believed, n [s].
        seen: offsets of the target then, n x 2 [rad].
        times: of the ticks, m [s].
        plays: places of the plays then, m x 2 x k [rad].
        prior: weights that are believed without evidence, k.
        radii: half-widths of the plays, k [rad].
        shift: of the exposures, as believed so far [s].

    Returns:
        What was found; None where neither handle moved.
    """
    basis, _ = np.linalg.qr(splines(t))
    tried = []
    for change in SHIFTS_S:
        moment = t + shift + change
        total = 0.0
        weights: list[Vector | None] = []
        spread: list[float] = []
        for axis in range(2):
            columns = np.column_stack([np.interp(moment, times, p) for p in plays[:, axis].T])
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
    return Found(found, shift_std, weights_of, width_std, float(np.sqrt(left)))


def _fit(
    columns: Vector, seen: Vector, basis: Vector, prior: Vector
) -> tuple[Vector, float, Vector]:
    """Weights of one axis, mean squared misfit [rad2], and the weights' covariance."""
    from scipy.optimize import nnls  # see prepare

    count, k = columns.shape
    free = columns - basis @ (basis.T @ columns)
    rest = basis @ (basis.T @ seen) - seen
    pull, whole = np.sqrt(RIDGE * count), np.sqrt(SLOPE_RIDGE * count)
    a = np.concatenate([free, pull * np.eye(k), np.full((1, k), whole)])
    b = np.concatenate([rest, pull * prior, [whole * prior.sum()]])
    weights, _ = nnls(a, b)
    misfit = float(np.mean((free @ weights - rest) ** 2))
    return np.asarray(weights), misfit, misfit * np.linalg.inv(a.T @ a)


def splines(t: Vector) -> Vector:
    """Cubic B-splines with even knots, at times from the first to the last, n x m."""
    first = float(t[0])
    count = int(np.ceil((float(t[-1]) - first) / KNOT_S)) + 3
    u = np.abs((t[:, None] - first) / KNOT_S - np.arange(count)[None] + 1.0)
    near, far = 2 / 3 - u**2 + u**3 / 2, np.maximum(2 - u, 0) ** 3 / 6
    basis: Vector = np.where(u < 1, near, far)
    return basis
