"""What a few seconds of frames tell of a loop: its width where it shows, nothing where not."""

from __future__ import annotations

import numpy as np
import pytest

from endolock.control.predictive import loop_evidence, online_plays
from endolock.control.predictive.handle_history import HALF_WIDTHS, PLAYS, HandleHistory
from endolock.control.predictive.loop_evidence import LoopEvidence
from endolock.hw.api import Vector

FRAME_S = 0.04
SLOPE = 0.97


def _evidence(handle: Vector, column: int, rough: Vector | float = 0.0) -> LoopEvidence:
    """Evidence of a bend that is one column, seen against a target at rest and what is rough."""
    history = HandleHistory((0.0, 0.0))
    times: Vector = FRAME_S * np.arange(len(handle), dtype=float)
    for t, h in zip(times.tolist(), handle.tolist(), strict=True):
        history.follow(t, (h, h))
    columns: Vector = history.columns[:, 0]
    basis: Vector = np.linalg.qr(online_plays.splines(times))[0]
    free = columns - basis @ (basis.T @ columns)
    bend = SLOPE * columns[:, column] + rough
    return loop_evidence.weigh(free, bend - basis @ (basis.T @ bend), SLOPE)


def _strokes(turns: list[float], seconds: float = 1.5) -> Vector:
    """Handle angles that go from turn to turn at constant speed [rad]."""
    frames = round(seconds / FRAME_S)
    return np.interp(np.arange(frames * (len(turns) - 1)) / frames, np.arange(len(turns)), turns)


@pytest.mark.parametrize("column", [2, 4, 6, 8])
def test_a_loop_is_evident_once_the_handle_went_through_and_back(column: int) -> None:
    found = _evidence(_strokes([0.0, 0.0, 1.2, 0.0, 0.9]), column)
    width = float(2 * HALF_WIDTHS[column])
    assert found.evident
    assert found.lowest <= width + 1e-9
    assert found.highest >= width - 1e-9
    assert found.slope == pytest.approx(SLOPE, rel=0.02)


def test_a_loop_that_the_handle_is_still_in_has_no_width() -> None:
    found = _evidence(_strokes([0.0, 0.0, 0.25, 0.25]), 7)
    assert found.gain > loop_evidence.CLEARLY
    assert found.highest == float("inf")
    assert not found.evident


def test_slack_is_told_from_friction_by_the_way_back() -> None:
    slack = PLAYS + 1
    there = _evidence(_strokes([0.0, 0.0, 1.2, 1.2]), slack)
    back = _evidence(_strokes([0.0, 0.0, 1.2, 0.0, -1.2, 0.0]), slack)
    assert HALF_WIDTHS[there.likeliest] == pytest.approx(HALF_WIDTHS[slack])
    assert back.likeliest == slack


def test_a_handle_at_rest_shows_no_loop() -> None:
    rough = 0.02 * np.random.default_rng(0).standard_normal(250)
    found = _evidence(np.zeros(250), 0, rough)
    assert found.gain == pytest.approx(0.0, abs=1e-6)
    assert not found.evident


def test_motion_of_the_target_alone_hardly_ever_looks_like_a_loop() -> None:
    """Without a loop, with a target that jerks for itself by as much as a handle does."""
    wrong = 0
    for seed in range(60):
        random = np.random.default_rng(seed)
        handle = _strokes([0.0, *random.uniform(-0.8, 0.8, 8).tolist()])
        rough = _strokes([0.0, *random.uniform(-0.3, 0.3, 14).tolist()], 1.0)[: len(handle)]
        wrong += _evidence(handle, 0, rough).evident
    assert wrong <= 2
