"""Whether the background is believed.

A background that belongs to something else, such as an instrument that moves, or whose scale is
wrong, turns without the handles, or too much for them: it is not used.
"""

from __future__ import annotations

from endolock.control.predictive.handle_history import PRIOR
from endolock.control.predictive.increment_fit import IncrementFit

UNEXPLAINED, SLOPES, TRUST_FRAMES = 0.5, (0.45, 1.8), 50
"""Share of the measured turns that the handles must explain, range of their slope relative to that
of a common endoscope, and frames before this is judged: otherwise the background is not believed.
Assumed."""
TURN_RAD = 0.015
"""Rms turn within a second above which the background can be judged [rad]. Assumed."""


def handles_explain(fit: IncrementFit, shift_s: float) -> bool:
    """Whether the handles explain the turns of the background, on both axes.

    Args:
        fit: evidence of the turns.
        shift_s: delay of the exposures [s].
    """
    return all(_axis_explained(fit, axis, shift_s) for axis in range(2))


def _axis_explained(fit: IncrementFit, axis: int, shift_s: float) -> bool:
    turned = fit.explained(axis)
    if turned < TURN_RAD**2:
        return True
    best = fit.solve(axis, shift_s, dead_zones=True)
    slope = float(best.weights.sum()) / float(PRIOR.sum())
    return best.residual < UNEXPLAINED * turned and SLOPES[0] < slope < SLOPES[1]
