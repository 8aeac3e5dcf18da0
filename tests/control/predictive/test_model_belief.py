"""When the background is believed, and when loops are that were found without one."""

from __future__ import annotations

import numpy as np
import pytest

from endolock.control.predictive import model_belief
from endolock.control.predictive.handle_history import PRIOR, HandleHistory
from endolock.control.predictive.increment_fit import SHIFTS_S, IncrementFit

FRAME_S = 0.04
BOTH = np.ones(2)


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
    assert model_belief.handles_explain(_evidence(scale, unrelated), 0.0) is believed


def test_a_background_that_hardly_turns_is_not_judged() -> None:
    assert model_belief.handles_explain(_evidence(0.0, 0.001), 0.0)
    assert model_belief.handles_explain(IncrementFit(), 0.0)


def _evident(went: float, *, width: float, std: float, ratio: float) -> bool:
    """Whether loops of both axes are evident, with handles that went so far [rad]."""
    angles = np.linspace(0.0, went, 50)[:, None] * BOTH
    return model_belief.loops_evident(angles, width * BOTH, std * BOTH, ratio * BOTH, BOTH)


@pytest.mark.parametrize(
    ("went", "width", "std", "ratio", "evident"),
    [
        (1.0, 0.6, 0.3, 3.0, True),  # through the loop, and it explains more
        (1.0, 0.6, 0.05, 1.0, True),  # through it, and its width is known
        (1.0, 0.6, 0.3, 1.2, False),  # it explains hardly more than none
        (0.65, 0.6, 0.05, 3.0, False),  # not beyond the loop
        (0.05, 0.0, 0.01, 9.0, False),  # at rest nothing is known
    ],
)
def test_a_loop_is_evident_beyond_it_and_by_what_it_explains(
    went: float, width: float, std: float, ratio: float, evident: bool
) -> None:
    assert _evident(went, width=width, std=std, ratio=ratio) is evident


def test_an_axis_at_rest_does_not_speak_against_the_other() -> None:
    angles = np.column_stack([np.linspace(0.0, 1.0, 50), np.zeros(50)])
    widths, std = np.array([0.6, 0.6]), np.array([0.3, 3.0])
    none, chosen = np.array([3.0, 1.0]), BOTH
    assert model_belief.loops_evident(angles, widths, std, none, chosen)
    angles[:, 1] = angles[:, 0]
    assert not model_belief.loops_evident(angles, widths, std, none, chosen)
