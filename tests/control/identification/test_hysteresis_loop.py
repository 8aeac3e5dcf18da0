"""Widths and deadbands of known loops."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.control.identification.hysteresis_loop import Branch, deadband, lost_after_turn, width
from endolock.control.transmission.plays import play
from endolock.hw.api import Vector

GAIN = 0.7
"""Bend per handle angle while the bend follows."""


def _follow(handle: Vector, width: float, dead: float) -> Vector:
    """Bend after an ideal play, a deadband around zero and a gain."""
    start = handle[0] - width / 2 if handle[-1] > handle[0] else handle[0] + width / 2
    taken = play(handle, width / 2, float(start))
    return GAIN * np.sign(taken) * np.maximum(0.0, np.abs(taken) - dead / 2)


def _loop(play: float, dead: float = 0.0, noise: float = 0.0) -> tuple[Branch, Branch]:
    stroke = np.linspace(2.0, -2.0, 2001)
    random = np.random.default_rng(0)
    both = (stroke, _follow(stroke, play, dead)), (stroke[::-1], _follow(stroke[::-1], play, dead))
    falling, rising = (
        Branch(handle, bend + noise * random.standard_normal(len(bend))) for handle, bend in both
    )
    return falling, rising


@given(play=st.floats(0.05, 1.0), bend=st.floats(-0.5, 0.5))
def test_the_width_of_a_play_is_measured(play: float, bend: float) -> None:
    measured = width(*_loop(play), bend)
    assert measured == pytest.approx(play, abs=0.004)  # two rows of 2 mrad


def test_noise_hardly_changes_a_width() -> None:
    noisy = width(*_loop(0.4, noise=np.radians(0.2)), 0.3)
    # the crossing is spread over 0.2 deg / 0.7, some 5 rows of 2 mrad
    assert noisy == pytest.approx(0.4, abs=0.01)


def test_a_bend_outside_the_loop_has_no_width() -> None:
    assert width(*_loop(0.4), 1.5) is None


@pytest.mark.parametrize("noise_deg", [0.0, 0.05])
@pytest.mark.parametrize("dead", [0.05, 0.2, 0.5])
def test_a_deadband_is_distinguished_from_play(dead: float, noise_deg: float) -> None:
    for branch in _loop(0.3, dead, np.radians(noise_deg)):
        # noise of 0.05 deg blurs either edge by 1.2 mrad; a few rows
        assert deadband(branch) == pytest.approx(dead, abs=0.006)


def test_play_alone_has_no_deadband() -> None:
    assert [deadband(branch) for branch in _loop(0.5, noise=np.radians(0.05))] == [0.0, 0.0]


@pytest.mark.parametrize("play", [0.1, 0.6])
def test_a_play_is_lost_at_the_reversal(play: float) -> None:
    stroke = np.linspace(1.0, -1.0, 1001)
    taken = np.clip(stroke, -9, 1.0 - play)  # it starts from a turn at the other edge of the play
    lost = lost_after_turn(Branch(stroke, GAIN * taken))
    assert lost == pytest.approx(play, abs=0.004)  # two rows of 2 mrad


def test_a_bend_that_never_follows_has_no_lost_motion() -> None:
    stroke = np.linspace(1.0, 0.0, 501)
    assert lost_after_turn(Branch(stroke, 0.05 * stroke)) is None
