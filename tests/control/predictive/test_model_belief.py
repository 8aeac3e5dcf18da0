"""When the background is believed."""

from __future__ import annotations

import numpy as np
import pytest

from endolock.control.predictive import model_belief
from endolock.control.predictive.handle_history import PRIOR, HandleHistory
from endolock.control.predictive.increment_fit import SHIFTS_S, IncrementFit

FRAME_S = 0.04


def _evidence(scale: float, unrelated: float) -> IncrementFit:
    """Turns that are the handles', times a scale, with others of an amplitude [rad] added."""
    history, fit = HandleHistory((0.0, 0.0)), IncrementFit()
    for t in np.arange(0.0, 16.0, 0.02).tolist():
        history.follow(t, (0.9 * float(np.sin(1.3 * t)), 0.9 * float(np.cos(0.9 * t))))
    times = np.arange(0.5, 15.0, FRAME_S)
    other = unrelated * np.column_stack([np.sin(2.1 * times), np.sin(1.7 * times)])
    for n in range(1, len(times)):
        columns = history.columns_at(times[n] + SHIFTS_S) - history.columns_at(
            times[n - 1] + SHIFTS_S
        )
        middle = len(SHIFTS_S) // 2
        turned = scale * columns[middle] @ PRIOR + other[n] - other[n - 1]
        fit.add(columns, turned, np.full(2, 1e-8), FRAME_S)
    return fit


@pytest.mark.parametrize(
    ("scale", "unrelated", "believed"),
    [
        (1.0, 0.0, True),
        (0.7, 0.0, True),  # instruments differ by as much
        (1.4, 0.0, True),
        (1.0, 0.15, True),  # a sixth of the handles' own
        (5.0, 0.0, False),
        (0.2, 0.0, False),
        (1.0, 1.8, False),  # twice the handles' own
        (0.0, 0.9, False),
    ],
)
def test_the_background_is_believed_if_the_handles_explain_it(
    scale: float, unrelated: float, believed: bool
) -> None:
    assert model_belief.handles_explain(_evidence(scale, unrelated), 0.0, 0.0) is believed


def test_a_background_that_hardly_turns_is_not_judged() -> None:
    assert model_belief.handles_explain(_evidence(0.0, 0.001), 0.0, 0.0)
    assert model_belief.handles_explain(IncrementFit(), 0.0, 0.0)
