"""Loops that are believed without a background: what is evident, what is kept, what is shared."""

from __future__ import annotations

import numpy as np
import pytest

from endolock.control.predictive import online_plays
from endolock.control.predictive.handle_history import COLUMNS, HALF_WIDTHS, PRIOR, HandleHistory
from endolock.control.predictive.loop_belief import LoopBelief
from endolock.control.predictive.online_plays import IdentifiedAxis
from endolock.hw.api import Vector

FRAME_S = 0.04


def _axis(handle: Vector, column: int) -> IdentifiedAxis:
    """What is identified of a handle whose bend is one column, before a target at rest."""
    history = HandleHistory((0.0, 0.0))
    times: Vector = FRAME_S * np.arange(len(handle), dtype=float)
    for t, h in zip(times.tolist(), handle.tolist(), strict=True):
        history.follow(t, (h, 0.0))
    noise = 1e-4 * np.random.default_rng(2).standard_normal((len(times), 2))
    seen = noise - 0.97 * history.columns[:, :, column]
    found = online_plays.identify(times, seen, history, 0.0, dead_zones=True)
    assert found is not None
    one = found.axes[0]
    assert one is not None
    return one


def _strokes(*turns: float) -> Vector:
    return np.interp(np.arange(40 * (len(turns) - 1)) / 40, np.arange(len(turns)), turns)


def _widths(belief: LoopBelief) -> Vector:
    widths: Vector = 2 * (belief.weights @ HALF_WIDTHS) / belief.weights.sum(axis=1)
    return widths


THROUGH = _strokes(0.0, 0.0, 1.2, 0.0, 0.9, -0.3)
SMOOTH = 0.2 * (1 - np.cos(np.arange(200) * 2 * np.pi / 200))
"""One slow turn of a handle within a loop of 0.6 rad or more."""


def test_nothing_is_believed_at_first_and_without_motion() -> None:
    belief = LoopBelief()
    belief.renew((None, None))
    assert belief.known == [False, False]
    assert (belief.weights == PRIOR).all()


@pytest.mark.parametrize("column", [3, 5, 7])
def test_an_evident_loop_is_believed_and_the_resting_axis_is_like_it(column: int) -> None:
    belief = LoopBelief()
    belief.renew((_axis(THROUGH, column), None))
    assert belief.known == [True, True]
    assert _widths(belief) == pytest.approx(2 * HALF_WIDTHS[column], abs=0.06)


def test_a_loop_is_kept_while_nothing_speaks_against_it() -> None:
    belief = LoopBelief()
    belief.renew((_axis(THROUGH, 6), None))
    belief.renew((None, None))
    belief.renew((_axis(SMOOTH, 6), None))
    assert belief.known == [True, True]
    assert _widths(belief) == pytest.approx(2 * HALF_WIDTHS[6], abs=0.06)


def test_a_loop_is_dropped_where_newer_frames_show_none() -> None:
    belief = LoopBelief()
    belief.renew((_axis(THROUGH, 6), None))
    belief.renew((_axis(THROUGH, 0), None))
    assert _widths(belief) == pytest.approx([0.0, 0.0], abs=0.06)


def test_axes_that_differ_are_not_taken_for_alike() -> None:
    belief = LoopBelief()
    belief.renew((_axis(THROUGH, 6), _axis(THROUGH, 0)))
    assert _widths(belief) == pytest.approx([0.6, 0.0], abs=0.06)
    belief.renew((None, _axis(THROUGH, 3)))
    assert belief.known == [True, True]
    assert _widths(belief) == pytest.approx([0.6, 0.3], abs=0.06)


def test_of_two_axes_the_one_with_less_evidence_is_like_the_other_if_it_may_be() -> None:
    belief = LoopBelief()
    short, long = _axis(THROUGH, 6), _axis(np.concatenate([THROUGH] * 3), 6)
    assert short.loop.gain < long.loop.gain
    belief.renew((short, long))
    assert belief.known == [True, True]
    assert belief.weights[0] == pytest.approx(long.weights)
    belief.renew((_axis(THROUGH, 4), long))  # it may not
    assert _widths(belief) == pytest.approx([0.4, 0.6], abs=0.06)


def test_what_the_background_showed_is_adopted() -> None:
    belief = LoopBelief()
    weights = np.full(COLUMNS, 0.04)
    belief.adopt(1, weights, 0.1)
    assert belief.known[1]
    assert belief.weights[1] == pytest.approx(weights)
    true = 0.97 * np.eye(COLUMNS)[6]
    belief.adopt(1, true, 0.1)
    belief.renew((_axis(THROUGH, 6), None))  # it is surer than a few frames
    assert belief.weights == pytest.approx(np.array([true, true]))
