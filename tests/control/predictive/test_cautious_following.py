"""Slow following while nothing is known: its time constant, its limits, its start."""

from __future__ import annotations

from math import exp

import numpy as np
import pytest

from endolock.control.predictive.cautious_following import (
    CAUTION_S,
    CAUTIOUS_RAD,
    CautiousFollowing,
)

BEND, TARGET = np.array([0.1, -0.1]), np.array([0.3, 0.2])


def _after(seconds: float, off_rad: float) -> CautiousFollowing:
    following = CautiousFollowing()
    for n in range(round(seconds / 0.02) + 1):
        following.follow(0.02 * n, TARGET, BEND, off_rad)
    return following


def test_it_starts_at_the_present_bend_and_follows_with_its_time_constant() -> None:
    assert _after(0.0, 0.05).place == pytest.approx(BEND)
    left = exp(-2.0) * (BEND - TARGET)
    assert _after(2.0 * CAUTION_S, 0.05).place == pytest.approx(TARGET + left, abs=0.002)


def test_far_from_the_axis_it_follows_at_once() -> None:
    assert _after(0.02, CAUTIOUS_RAD[1]).place == pytest.approx(TARGET)


def test_once_stopped_it_starts_again_at_the_bend_then() -> None:
    following = _after(1.0, 0.05)
    following.stop()
    following.move(np.ones(2))  # nothing to move
    assert following.follow(9.0, TARGET, -BEND, 0.05) == pytest.approx(-BEND)


def test_a_change_of_the_model_moves_the_place_with_it() -> None:
    following = _after(1.0, 0.05)
    before = following.place
    assert before is not None
    following.move(np.array([0.05, -0.02]))
    assert following.place == pytest.approx(before + [0.05, -0.02])
