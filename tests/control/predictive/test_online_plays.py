"""Weights of the columns from frames of a target that moves smoothly, without a background."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from endolock.control.predictive import online_plays
from endolock.control.predictive.handle_history import COLUMNS, HALF_WIDTHS, HandleHistory
from endolock.hw.api import Vector

FRAME_S = 0.04
TICKS = np.arange(0.0, 25.0, 0.02)
FRAMES = np.arange(1.0, 24.0, FRAME_S)


def _history(handle: Vector) -> HandleHistory:
    history = HandleHistory((0.0, 0.0))
    for t, h in zip(TICKS.tolist(), handle.tolist(), strict=True):
        history.follow(t, (h, h))
    return history


def _width(weights: Vector) -> float:
    return float(2 * (weights @ HALF_WIDTHS) / weights.sum())


@pytest.mark.parametrize("dead_zones", [False, True])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_weights_and_latency_are_identified_from_frames(noise: float, dead_zones: bool) -> None:
    random = np.random.default_rng(1)
    # Strokes of all sizes, so that every play moves.
    turns = random.uniform(-0.9, 0.9, 26)
    history = _history(np.interp(TICKS, np.arange(26.0), turns))
    true = np.zeros(COLUMNS)
    true[[4, 6]] = 0.5, 0.45
    late_s = 0.02
    target = 0.3 * (1 - np.cos(2 * pi * FRAMES / 8.6)) + 0.05 * np.sin(2 * pi * FRAMES / 3.1)
    bend = history.columns_at(FRAMES + late_s)[:, 0] @ true
    seen = target - bend + noise * random.standard_normal(len(FRAMES))
    found = online_plays.identify(
        FRAMES, np.column_stack([seen, seen]), history, 0.0, dead_zones=dead_zones
    )
    assert found is not None
    assert found.shift_s == pytest.approx(late_s)
    one = found.axes[0]
    assert one is not None
    assert one.loop.evident
    # The splines absorb a little of the reversals.
    assert _width(one.weights) == pytest.approx(_width(true), rel=0.05)
    assert one.allows(true, 2.0)
    assert not one.allows(0.95 * np.eye(COLUMNS)[0], 5.0)


def test_a_tip_that_turns_the_wrong_way_gets_no_weights_but_a_finite_width() -> None:
    handle = 0.6 * np.sin(1.1 * TICKS) + 0.3 * np.sin(5.3 * TICKS)
    history = _history(handle)
    seen = history.columns_at(FRAMES)[:, :, 5]  # the offset rises with the bend instead of falling
    found = online_plays.identify(FRAMES, seen, history, 0.0, dead_zones=True)
    assert found is not None
    for one in found.axes:
        assert one is not None
        assert not one.weights.any()
        assert not one.loop.evident
        assert np.isfinite(one.width_std)


def test_a_handle_at_rest_identifies_nothing() -> None:
    seen = np.random.default_rng(0).standard_normal((len(FRAMES), 2))
    history = _history(np.zeros(len(TICKS)))
    assert online_plays.identify(FRAMES, seen, history, 0.0, dead_zones=True) is None
