"""Candidates for the transmission are compared on newer frames, and only there."""

from __future__ import annotations

import numpy as np
import pytest

from endolock.control.predictive.capstan_model import CapstanModel, rotation
from endolock.control.predictive.competition import (
    CLEARLY,
    EARN,
    JUDGED_S,
    NEW_FRAMES,
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


def _judged(
    truth: Vector, *, background: bool, seconds: float = 20.0, video_rad: float = 0.0
) -> Competition:
    """Let no hysteresis and one play compete on a plant with given weights, in a rotated video."""
    rivals, history = Competition(), HandleHistory((0.0, 0.0))
    rivals.candidates[:, 1] = rivals.candidates[:, 2] = PLAY
    frames: list[SeenFrame] = []
    turns = np.random.default_rng(0).uniform(-0.9, 0.9, (60, 2))
    for n in range(int(seconds / FRAME_S)):
        t = n * FRAME_S
        first, second = (np.interp(t, np.arange(60), column) for column in turns.T)
        history.follow(t, (float(first), float(second)))
        columns = history.columns[-1].copy()
        bend = columns @ truth @ rotation(video_rad)
        target = np.array([0.4 * np.sin(0.5 * t), 0.4 * np.cos(0.6 * t)])
        frames.append(SeenFrame(t, bend, target - bend, columns, background))
        if n:
            rivals.judge(
                frames,
                np.array([PRIOR, PRIOR]),
                CapstanModel(),
                history,
                turn=video_rad,
                background=background,
                capstan_used=False,
            )
    return rivals


RISE = np.array([0.05, -0.02])
"""Rise of both bends from frame to frame [rad]."""


class Ramp:
    """Handles at rest and bends that rise by `RISE` every frame: a capstan explains a share of it.

    Args:
        share: of the rise, by the capstan [1].
        wild_s: time until which the capstan's bends are random [s].
    """

    def __init__(self, share: float, wild_s: float = 0.0) -> None:
        self.history, self.capstan = HandleHistory((0.0, 0.0)), CapstanModel()
        self.frames: list[SeenFrame] = []
        random = np.random.default_rng(0)
        bends = []
        for n in range(101):
            t = n * FRAME_S
            self.history.follow(t, (0.0, 0.0))
            columns = self.history.columns[-1].copy()
            self.frames.append(SeenFrame(t, n * RISE, np.zeros(2), columns, True))
            up_down, left_right = (
                random.normal(0, 1, 2) if t < wild_s else share * n * RISE
            ).tolist()
            bends.append((up_down, left_right))
        self.capstan._keep(bends)

    def replaced(self, rivals: Competition, fitted_s: float) -> None:
        """Show the competition this capstan, found from frames up to a time."""
        self.capstan.fitted_s = fitted_s
        weights = np.array([PRIOR, PRIOR])
        rivals.capstan_replaced(
            self.frames, weights, self.capstan, self.history, turn=0.0, background=True
        )

    def judged(self, rivals: Competition, last: int) -> None:
        """Let the newest frames be judged, this many."""
        for n in range(len(self.frames) - last + 1, len(self.frames) + 1):
            rivals.judge(
                self.frames[:n],
                np.array([PRIOR, PRIOR]),
                self.capstan,
                self.history,
                turn=0.0,
                background=True,
                capstan_used=False,
            )


SPAN = 12
"""Frames from the newest that is not within the horizon to the present one."""
LEFT_RAD2 = float((SPAN * RISE) @ (SPAN * RISE))
"""What the columns leave unexplained at every frame of a ramp [rad2]."""


@pytest.mark.parametrize("background", [True, False])
def test_the_model_that_explains_newer_frames_is_chosen(background: bool) -> None:
    for truth, right, wrong in ((PLAY, 1, 0), (PRIOR, 0, 1)):
        rivals = _judged(truth, background=background)
        assert (rivals.errors[:, right] < 0.1 * rivals.errors[:, wrong]).all()
        assert rivals.choose().tolist() == [rivals.candidates[0, right].tolist()] * 2


@pytest.mark.parametrize("video_rad", [0.0, 0.25, -0.25])
def test_with_a_background_the_right_model_leaves_nothing_unexplained(video_rad: float) -> None:
    assert _judged(PRIOR, background=True, video_rad=video_rad).usual < 1e-5  # it begins with that
    rivals = _judged(PLAY, background=True, video_rad=video_rad)
    assert rivals.usual > 1e-3  # no hysteresis was in use
    assert rivals.errors[:, 1].max() < 1e-7  # the right one: rounding, and what errors begin with


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


@pytest.mark.parametrize("video_rad", [0.0, 0.25])
def test_a_capstan_that_was_not_compared_yet_has_not_earned_it(video_rad: float) -> None:
    rivals = _judged(PLAY, background=True, video_rad=video_rad)
    assert not rivals.capstan_earns(used=False)
    Ramp(share=0.0).replaced(rivals, fitted_s=2.0)  # no better than the columns
    assert rivals.by_capstan == pytest.approx(rivals.by_columns)
    assert not rivals.capstan_earns(used=False)


@pytest.mark.parametrize("fitted_s", [1.0, 2.0, 3.0])
@pytest.mark.parametrize("share", [1.0, 0.5, 0.0, -1.0])
def test_a_new_capstan_is_charged_on_the_frames_since_its_window(
    share: float, fitted_s: float
) -> None:
    """Relative to the columns, which had an easy time before, and with a second of credit."""
    rivals = Competition()
    rivals.by_columns = rivals.by_capstan = easy = LEFT_RAD2 / 7
    Ramp(share, wild_s=fitted_s).replaced(rivals, fitted_s)
    count = sum(n * FRAME_S > fitted_s + 0.45 for n in range(101))
    mine = (1 - share) ** 2 * LEFT_RAD2 * count + NEW_FRAMES * easy
    assert rivals.by_columns == easy
    assert rivals.by_capstan / easy == pytest.approx(mine / (LEFT_RAD2 * count + NEW_FRAMES * easy))


def test_without_frames_since_its_window_a_new_capstan_counts_as_the_one_before() -> None:
    rivals = Competition()
    rivals.by_columns, rivals.by_capstan = 1.0, 0.3
    Ramp(share=-1.0).replaced(rivals, fitted_s=3.9)
    assert rivals.by_capstan == 0.3


def test_what_a_bad_capstan_left_unexplained_is_not_charged_to_its_successor() -> None:
    rivals = Competition()
    rivals.by_columns, rivals.by_capstan = LEFT_RAD2, 50 * LEFT_RAD2
    Ramp(share=1.0).replaced(rivals, fitted_s=2.0)
    assert rivals.capstan_earns(used=False)


def test_after_a_surprise_capstan_and_columns_start_alike() -> None:
    """What was before counts for `JUDGED_S`, then means are those of the frames since."""
    rivals, ramp = Competition(), Ramp(share=0.5)
    old = 3 * LEFT_RAD2
    rivals.by_columns, rivals.by_capstan = old, 1e-6
    rivals.usual, rivals.recent = 1e-6, 1e-3
    assert rivals.surprised(20.0)
    assert rivals.by_capstan == rivals.by_columns == old
    ramp.judged(rivals, last=25)
    new_s = 25 * FRAME_S
    for mean, left in ((rivals.by_columns, 1.0), (rivals.by_capstan, 0.25)):
        expected = (JUDGED_S * old + new_s * left * LEFT_RAD2) / (JUDGED_S + new_s)
        assert mean == pytest.approx(expected)
    assert rivals.capstan_earns(used=False)  # within a second


def test_a_sudden_misfit_is_a_surprise_once_within_the_patience() -> None:
    rivals = Competition()
    assert not rivals.surprised(1.0)
    rivals.usual, rivals.recent = 1e-5, 1e-4
    assert not rivals.surprised(1.0)  # ten times the usual, but 10 mrad is little
    rivals.recent = 1e-3
    assert rivals.surprised(1.0)
    assert not rivals.surprised(1.0 + 0.9 * PATIENCE_S)
    assert rivals.surprised(1.0 + 1.1 * PATIENCE_S)
