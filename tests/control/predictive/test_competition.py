"""Candidates for the transmission are compared on newer frames, and only there."""

from __future__ import annotations

import numpy as np
import pytest

from endolock.control.predictive.capstan_model import CapstanModel
from endolock.control.predictive.competition import (
    CLEARLY,
    EARN,
    LARGE_RAD2,
    PATIENCE_S,
    Competition,
)
from endolock.control.predictive.handle_history import PRIOR, HandleHistory
from endolock.control.predictive.seen_frames import SeenFrame
from endolock.hw.api import Vector

FRAME_S = 0.04
PLAY = np.zeros_like(PRIOR)
PLAY[6] = PRIOR[0]
"""One play of 0.3 rad."""


def _judged(truth: Vector, *, background: bool, seconds: float = 20.0) -> Competition:
    """Let no hysteresis and one play compete on a plant with given weights."""
    rivals, history = Competition(), HandleHistory((0.0, 0.0))
    rivals.candidates[:, 1] = rivals.candidates[:, 2] = PLAY
    frames: list[SeenFrame] = []
    turns = np.random.default_rng(0).uniform(-0.9, 0.9, (60, 2))
    for n in range(int(seconds / FRAME_S)):
        t = n * FRAME_S
        first, second = (np.interp(t, np.arange(60), column) for column in turns.T)
        history.follow(t, (float(first), float(second)))
        columns = history.columns[-1].copy()
        bend = columns @ truth
        target = np.array([0.4 * np.sin(0.5 * t), 0.4 * np.cos(0.6 * t)])
        frames.append(SeenFrame(t, bend, target - bend, columns, background))
        if n:
            rivals.judge(
                frames,
                np.array([PRIOR, PRIOR]),
                CapstanModel(),
                history,
                background=background,
                capstan_used=False,
            )
    return rivals


@pytest.mark.parametrize("background", [True, False])
def test_the_model_that_explains_newer_frames_is_chosen(background: bool) -> None:
    for truth, right, wrong in ((PLAY, 1, 0), (PRIOR, 0, 1)):
        rivals = _judged(truth, background=background)
        assert (rivals.errors[:, right] < 0.1 * rivals.errors[:, wrong]).all()
        assert rivals.choose().tolist() == [rivals.candidates[0, right].tolist()] * 2


def test_with_a_background_the_right_model_leaves_nothing_unexplained() -> None:
    assert _judged(PRIOR, background=True).usual < 1e-5  # what it begins with
    assert _judged(PLAY, background=True).usual > 1e-3  # no hysteresis was in use


def test_a_choice_is_kept_until_another_is_clearly_better() -> None:
    rivals = Competition()
    rivals.candidates[:, 1] = PLAY
    rivals.errors[:] = [[1.0, 0.99 * CLEARLY, 9.0], [1.0, 1.01 * CLEARLY, 9.0]]
    rivals.choose()
    assert rivals.choice == [1, 0]
    rivals.errors[:] = [[0.99, 1.0, 9.0], [0.99, 1.0, 9.0]]
    rivals.choose()
    assert rivals.choice == [1, 0]


def test_the_capstan_earns_its_place_and_loses_it() -> None:
    rivals = Competition()
    rivals.by_columns = 1.0
    for error, used, after in (
        (1.01 * EARN, False, False),
        (0.99 * EARN, False, True),
        (0.99, True, True),
        (1.01, True, False),
    ):
        rivals.by_capstan = error
        assert rivals.capstan_earns(used) is after
    rivals.by_capstan = 1e-9
    rivals.capstan_replaced()  # one that was not compared yet
    assert not rivals.capstan_earns(used=False)


def test_a_sudden_misfit_is_a_surprise_once_and_drops_the_capstan() -> None:
    rivals = Competition()
    assert not rivals.surprised(1.0)
    rivals.usual, rivals.recent = 1e-5, 1e-4
    assert not rivals.surprised(1.0)  # ten times the usual, but 10 mrad is little
    rivals.recent = 1e-3
    assert rivals.surprised(1.0)
    assert rivals.by_capstan == LARGE_RAD2
    assert not rivals.surprised(1.0 + 0.9 * PATIENCE_S)
    assert rivals.surprised(1.0 + 1.1 * PATIENCE_S)
