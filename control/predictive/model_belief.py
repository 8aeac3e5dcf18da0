"""Whether the background is believed, and loops of the handles that were found without one.

A background that belongs to something else, such as an instrument that moves, or whose scale is
wrong, turns without the handles, or too much for them: it is not used. Without a background the
target's own motion may look like a loop: a loop is believed after the handle went through it and
beyond, where it explains newer frames better than no loop, or where it is known to be narrow; or
where it explains them far better.
"""

from __future__ import annotations

import numpy as np

from endolock.control.predictive.handle_history import PRIOR
from endolock.control.predictive.increment_fit import IncrementFit
from endolock.hw.api import Vector

UNEXPLAINED, SLOPES, TRUST_FRAMES = 0.5, (0.45, 1.8), 50
"""Share of the measured turns that the handles must explain, range of their slope relative to that
of a common endoscope, and frames before this is judged: otherwise the background is not believed.
Assumed."""
TURN_RAD = 0.015
"""Rms turn within a second above which the background can be judged [rad]. Assumed."""
EVIDENT, STRIKING = 1.5, 6.0
"""Ratios of squared errors, no hysteresis over the found loops: above the first loops are evident
if the handle has gone through them, above the second in any case. Assumed."""
SURE = 4.0
"""Width over its standard deviation above which a loop is known to be there [1]. Assumed."""
LEAST_RANGE_RAD, THROUGH_RAD = 0.1, 0.1
"""Range of a handle below which its axis is at rest, and by how much the handle must have gone
beyond a loop [rad]. Assumed."""
NARROW_RAD = 0.1
"""Standard deviation of a loop's width below which it is known [rad]. Assumed: a sixth of the
widest."""


def handles_explain(fit: IncrementFit, shift_s: float) -> bool:
    """Whether the handles explain the turns of the background, on both axes.

    Args:
        fit: evidence of the turns.
        shift_s: delay of the exposures [s].
    """
    return all(_axis_explained(fit, axis, shift_s) for axis in range(2))


def loops_evident(
    angles: Vector, widths: Vector, width_std: Vector, none: Vector, chosen: Vector
) -> bool:
    """Whether loops are evident without a background, on each axis that moves.

    Args:
        angles: handle angles of the past, n x 2 [rad].
        widths: widths of the loops, 2 [rad].
        width_std: their standard deviations, 2 [rad].
        none: squared errors without hysteresis on newer frames, 2 [rad2].
        chosen: those with the loops, 2 [rad2].
    """
    ranges = np.ptp(angles, axis=0)
    moving = ranges > LEAST_RANGE_RAD
    if not moving.any():
        return False
    better = none > EVIDENT * chosen
    through = ranges > widths + THROUGH_RAD
    sure = width_std < np.maximum(NARROW_RAD, widths / SURE)
    striking = none > STRIKING * chosen
    return bool(np.all(~moving | striking | (through & (better | sure))))


def _axis_explained(fit: IncrementFit, axis: int, shift_s: float) -> bool:
    turned = fit.explained(axis)
    if turned < TURN_RAD**2:
        return True
    best = fit.solve(axis, shift_s, dead_zones=True)
    slope = float(best.weights.sum()) / float(PRIOR.sum())
    return best.residual < UNEXPLAINED * turned and SLOPES[0] < slope < SLOPES[1]
