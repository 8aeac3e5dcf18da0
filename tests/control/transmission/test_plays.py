"""Prandtl-Ishlinskii hysteresis: its defining properties, its inverse, its fit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.control.transmission import plays
from endolock.control.transmission.plays import Hysteresis, Plays
from endolock.hw.api import ConfigError

PLAYS = Plays(radii=(0.0, 0.1, 0.3, 0.5), weights=(0.1, 0.3, 0.4, 0.2))
ROUNDING = 1e-12  # a few dozen operations on numbers of order one
HISTORIES = st.lists(st.floats(-2, 2), max_size=12)


def after(history: list[float]) -> Hysteresis:
    axis = Hysteresis(PLAYS)
    for handle in history:
        axis.follow(handle)
    return axis


@given(history=HISTORIES, bend=st.floats(-1.5, 1.5))
def test_the_inverse_gives_the_bend_from_any_state(history: list[float], bend: float) -> None:
    axis = after(history)
    handle = axis.handle_for(bend)
    assert axis.follow(handle) == pytest.approx(bend, abs=ROUNDING)


@given(history=HISTORIES, end=st.floats(-2, 2), cuts=st.integers(1, 20))
def test_only_the_reversals_count_not_the_rate(history: list[float], end: float, cuts: int) -> None:
    quick, slow = after(history), after(history)
    start = history[-1] if history else 0.0
    for n in range(1, cuts + 1):
        slow.follow(start + n / cuts * (end - start))
    assert slow.bend_rad == pytest.approx(quick.follow(end), abs=ROUNDING)


@given(history=HISTORIES, out=st.floats(0, 0.5))
def test_a_small_loop_closes(history: list[float], out: float) -> None:
    axis = after([*history, 2.0])  # on the way up
    before = axis.bend_rad
    axis.follow(2.0 - out)
    assert axis.follow(2.0) == pytest.approx(before, abs=ROUNDING)


def test_a_play_loses_its_width_at_each_reversal() -> None:
    axis = Hysteresis(Plays(radii=(0.3,), weights=(0.9,)))
    top = axis.follow(1.0)
    assert top == pytest.approx(0.9 * 0.7, abs=ROUNDING)
    assert axis.follow(1.0 - 0.6) == pytest.approx(top, abs=ROUNDING)
    assert axis.follow(1.0 - 0.7) == pytest.approx(top - 0.9 * 0.1, abs=ROUNDING)


def test_for_the_current_bend_the_handle_goes_to_the_middle_of_the_deadband() -> None:
    axis = Hysteresis(Plays(radii=(0.3,), weights=(0.9,)))
    axis.follow(1.0)
    assert axis.handle_for(axis.bend_rad) == pytest.approx(0.7, abs=ROUNDING)


def test_a_fit_finds_the_weights() -> None:
    random = np.random.default_rng(0)
    handle = np.cumsum(0.02 * np.sign(random.standard_normal(3000)).repeat(5)[:3000])
    bend = sum(w * plays.play(handle, r) for r, w in zip(PLAYS.radii, PLAYS.weights, strict=True))
    found, misfit = plays.fit(handle, np.asarray(bend), np.linspace(0.0, 0.6, 7).tolist())
    assert misfit < 1e-9  # the true radii are among those offered
    assert found.radii == pytest.approx(PLAYS.radii)
    assert found.weights == pytest.approx(PLAYS.weights, abs=1e-9)


@pytest.mark.parametrize(
    ("radii", "weights"), [((), ()), ((0.1,), (0.0,)), ((-0.1,), (1.0,)), ((0.1, 0.2), (1.0,))]
)
def test_impossible_plays_are_refused(radii: tuple[float, ...], weights: tuple[float, ...]) -> None:
    with pytest.raises(ConfigError, match="give the same number of each"):
        Plays(radii=radii, weights=weights)
