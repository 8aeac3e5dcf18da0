"""The history of the handles: columns, their values between ticks, and the inverse of their sum."""

from __future__ import annotations

from itertools import pairwise
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.control.predictive.handle_history import (
    COLUMNS,
    PRIOR,
    RADII,
    ROOM,
    SLACKS,
    HandleHistory,
    handle_for,
)
from endolock.control.transmission.plays import play_step
from endolock.hw.api import Vector

ANGLES = st.floats(-1.5, 1.5)
WEIGHTS = st.lists(
    st.sampled_from([0.0, 0.0, 0.1, 0.3, 0.9]), min_size=COLUMNS, max_size=COLUMNS
).filter(lambda weights: sum(weights) > 0)


def _after(turns: list[float]) -> HandleHistory:
    history = HandleHistory((0.0, 0.0))
    for n, turn in enumerate(turns):
        history.follow(0.02 * n, (turn, -turn))
    return history


def _dead(handle: float, slack: float) -> float:
    """Output of a dead zone [rad]."""
    return float(np.sign(handle)) * max(abs(handle) - slack, 0.0)


def _bend(history: HandleHistory, weights: Vector, handle: float) -> float:
    """Bend of the first axis with its handle moved to an angle."""
    columns = [
        play_step(z, _dead(handle, s), r)
        for z, s, r in zip(history.outputs[0].tolist(), SLACKS, RADII, strict=True)
    ]
    return float(np.array(columns) @ weights)


@given(st.lists(ANGLES, min_size=1, max_size=8))
def test_columns_are_plays_behind_dead_zones(turns: list[float]) -> None:
    columns = _after(turns).columns[-1]
    assert columns.shape == (2, COLUMNS)
    expected = [0.0] * COLUMNS
    for turn in turns:
        expected = [
            play_step(z, _dead(turn, s), r) for z, s, r in zip(expected, SLACKS, RADII, strict=True)
        ]
    assert columns[0] == pytest.approx(expected)
    assert columns[1] == pytest.approx(-columns[0])  # the handles are mirrored, and so are these


@given(st.lists(ANGLES, min_size=1, max_size=8), WEIGHTS, st.floats(-1.0, 1.0))
@settings(deadline=None)
def test_the_inverse_gives_the_bend_at_the_nearest_angle(
    turns: list[float], weights: list[float], bend: float
) -> None:
    history, weight = _after(turns), np.array(weights)
    found = handle_for(weight, history.outputs[0], turns[-1], bend, reach=pi)
    lowest, highest = (_bend(history, weight, reach) for reach in (-pi, pi))
    assert _bend(history, weight, found) == pytest.approx(
        float(np.clip(bend, lowest, highest)), abs=1e-9
    )
    if abs(bend - _bend(history, weight, turns[-1])) < 1e-6:
        return  # there already, up to rounding
    # an angle between here and there has another bend: none is nearer
    for part in (0.0, 0.5, 0.99):
        between = turns[-1] + part * (found - turns[-1])
        if abs(found - between) > 1e-6:
            short = abs(_bend(history, weight, between) - _bend(history, weight, turns[-1]))
            assert short < abs(_bend(history, weight, found) - _bend(history, weight, turns[-1]))


@given(st.lists(ANGLES, min_size=1, max_size=8), WEIGHTS)
@settings(deadline=None)
def test_a_larger_bend_needs_a_larger_angle(turns: list[float], weights: list[float]) -> None:
    history, weight = _after(turns), np.array(weights)
    found = [
        handle_for(weight, history.outputs[0], turns[-1], bend, reach=pi)
        for bend in np.linspace(-1.0, 1.0, 21).tolist()
    ]
    assert all(a <= b + 1e-12 for a, b in pairwise(found))


def test_the_present_bend_needs_no_motion_and_no_model_has_no_loop() -> None:
    history = _after([0.4, 0.1])
    for weights in (PRIOR, np.full(COLUMNS, 0.05)):
        bend = _bend(history, weights, 0.1)
        assert handle_for(weights, history.outputs[0], 0.1, bend, reach=pi) == pytest.approx(0.1)
    assert handle_for(PRIOR, history.outputs[0], 0.1, 0.2, reach=pi) == pytest.approx(
        0.2 / PRIOR[0]
    )


def test_between_ticks_columns_are_interpolated_and_beyond_them_held() -> None:
    history = _after([0.0, 0.5, -0.5, 0.2])
    first, second = history.columns[1], history.columns[2]
    quarter, before, after = history.columns_at(np.array([0.025, -1.0, 9.0]))
    assert quarter == pytest.approx(0.75 * first + 0.25 * second)
    assert before == pytest.approx(history.columns[0])
    assert after == pytest.approx(history.columns[-1])


def test_a_tick_that_is_not_newer_is_ignored() -> None:
    history = _after([0.0, 0.5])
    history.follow(0.02, (3.0, 3.0))
    assert len(history.times) == 2
    assert history.handles.tolist() == [0.5, -0.5]


def test_a_full_history_forgets_its_oldest_quarter() -> None:
    history = HandleHistory((0.0, 0.0))
    for n in range(ROOM + 1):
        history.follow(float(n), (1e-4 * n, 0.0))
    assert history.times[0] == ROOM // 4
    assert history.times[-1] == ROOM
    assert history.angles[:, 0] == pytest.approx(1e-4 * history.times)
