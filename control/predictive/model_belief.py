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


def handles_explain(fit: IncrementFit, shift_s: float, turn: float) -> bool:
    """Whether the handles explain the turns of the background.

    Args:
        fit: evidence of the turns.
        shift_s: delay of the exposures [s].
        turn: rotation of the video about its optical axis [rad].
    """
    turned = [fit.turned(axis) for axis in range(2)]
    if max(turned) < TURN_RAD**2:
        return True
    best = [fit.solve(axis, shift_s, True, turn) for axis in range(2)]
    return sum(one.residual for one in best) < UNEXPLAINED * sum(turned) and all(
        SLOPES[0] < float(one.weights.sum()) / float(PRIOR.sum()) < SLOPES[1] for one in best
    )
