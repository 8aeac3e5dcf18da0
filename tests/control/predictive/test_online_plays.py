"""Weights of the plays from frames of a target that moves smoothly, without a background."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from endolock.control.predictive import online_plays
from endolock.control.predictive.handle_history import PLAYS, PRIOR, RADII
from endolock.control.transmission.plays import play

FRAME_S = 0.04
PLAIN = RADII[:PLAYS]


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_weights_and_latency_are_identified_from_frames(noise: float) -> None:
    times = np.arange(0.0, 25.0, 0.02)
    random = np.random.default_rng(1)
    target = 0.3 * (1 - np.cos(2 * pi * times / 8.6)) + 0.05 * np.sin(2 * pi * times / 3.1)
    # Strokes of all sizes, so that every play moves.
    turns = random.uniform(-0.9, 0.9, 26)
    handle = np.interp(times, np.arange(26.0), turns)
    plays = np.stack([np.column_stack([play(handle, r) for r in PLAIN])] * 2, axis=1)
    true = np.zeros(PLAYS)
    true[[4, 6]] = 0.5, 0.45
    late_s = 0.02
    t = np.arange(1.0, 24.0, FRAME_S)
    bend = np.interp(t + late_s, times, plays[:, 0] @ true)
    seen = np.interp(t + late_s, times, target) - bend + noise * random.standard_normal(len(t))
    found = online_plays.identify(
        t, np.column_stack([seen, seen]), times, plays, PRIOR[:PLAYS], PLAIN, 0.0
    )
    assert found is not None
    assert found.shift_s == pytest.approx(late_s)
    weights = found.weights[0]
    assert weights is not None
    width = 2 * (weights @ PLAIN) / weights.sum()
    expected = 2 * (true @ PLAIN) / true.sum()
    assert width == pytest.approx(
        expected, rel=0.05
    )  # the splines absorb a little of the reversals


def test_a_handle_at_rest_identifies_nothing() -> None:
    times = np.arange(0.0, 25.0, 0.02)
    t = np.arange(1.0, 24.0, FRAME_S)
    plays = np.zeros((len(times), 2, PLAYS))
    seen = np.random.default_rng(0).standard_normal((len(t), 2))
    found = online_plays.identify(t, seen, times, plays, PRIOR[:PLAYS], PLAIN, 0.0)
    assert found is None
