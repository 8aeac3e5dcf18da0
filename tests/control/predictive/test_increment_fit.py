"""Weights from increments of the bend: what they recover, from how much, and how sure they are."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from endolock.control.predictive.handle_history import (
    COLUMNS,
    HALF_WIDTHS,
    PLAYS,
    PRIOR,
    HandleHistory,
)
from endolock.control.predictive.increment_fit import SHIFTS_S, IncrementFit
from endolock.hw.api import Vector

FRAME_S = 0.04
NOISE_RAD = 2e-4
"""Noise of an increment: that of turns measured on pictures, docs/vision.md."""


def _weights(**parts: float) -> Vector:
    """Weights of columns by their number, such as c6=0.5."""
    weights = np.zeros(COLUMNS)
    for name, weight in parts.items():
        weights[int(name[1:])] = weight
    return weights


def _fitted(
    weights: Vector,
    seconds: float = 25.0,
    *,
    late_s: float = 0.0,
    amplitude: float = 0.8,
    seed: int = 0,
    noise_rad: float = NOISE_RAD,
) -> IncrementFit:
    """Evidence of strokes of random sizes on both handles, with the same plant on both."""
    random = np.random.default_rng(seed)
    turns = random.uniform(-amplitude, amplitude, (int(seconds) + 4, 2))
    history = HandleHistory((0.0, 0.0))
    for t in np.arange(0.0, seconds, 0.02).tolist():
        first, second = (np.interp(t, np.arange(len(turns)), column) for column in turns.T)
        history.follow(t, (float(first), float(second)))
    fit = IncrementFit()
    times = np.arange(0.5, seconds - 0.5, FRAME_S)
    for before, t in pairwise(times):
        columns = history.columns_at(t + SHIFTS_S) - history.columns_at(before + SHIFTS_S)
        true = history.columns_at(np.array([before, t]) + late_s)
        bend = (true[1] - true[0]) @ weights + noise_rad * random.standard_normal(2)
        fit.add(columns, bend, np.full(2, noise_rad**2), FRAME_S)
    return fit


def _width(weights: Vector) -> float:
    return float(2 * weights @ HALF_WIDTHS / weights.sum())


@pytest.mark.parametrize(
    "true",
    [PRIOR, _weights(c6=0.9), _weights(c2=0.3, c8=0.6), _weights(c0=0.2, c4=0.3, c10=0.4)],
    ids=["no loop", "one play", "two plays", "three plays"],
)
def test_plays_are_recovered(true: Vector) -> None:
    found = _fitted(true).solve(0, 0.0, dead_zones=False)
    assert found.weights.min() >= 0.0
    assert found.weights.sum() == pytest.approx(true.sum(), rel=0.03)  # the slope's prior is weak
    # the price on widths narrows them by a little
    assert _width(found.weights) == pytest.approx(_width(true), abs=0.02)
    assert found.residual < (0.01) ** 2


def test_a_dead_zone_is_recovered_only_where_it_is_a_candidate() -> None:
    true = _weights(**{f"c{PLAYS + 2}": 0.9})
    fit = _fitted(true)
    with_zones, without = (fit.solve(0, 0.0, dead_zones=zones) for zones in (True, False))
    assert without.weights[PLAYS:].tolist() == [0.0] * (COLUMNS - PLAYS)
    assert with_zones.weights[PLAYS:].sum() > 0.9 * with_zones.weights.sum()
    assert with_zones.residual < 0.1 * without.residual


@pytest.mark.parametrize("late_s", [-0.1, 0.03, 0.12])
def test_the_delay_is_where_the_residual_is_least(late_s: float) -> None:
    true = _weights(c3=0.4, c7=0.5)
    fit = _fitted(true, late_s=late_s)
    assert fit.delay(0.0) is None  # before all of them were looked at
    for _ in SHIFTS_S:
        fit.look_for_delay(dead_zones=True, turn=0.0)
    found = fit.delay(0.0)
    assert found is not None
    # columns between the compared delays are interpolated, and corners of strokes are not parabolas
    assert found[0] == pytest.approx(late_s, abs=0.01)
    assert found[1] < 0.02


def test_with_little_evidence_loops_stay_narrow() -> None:
    true = _weights(c8=0.9)
    widths = [
        _width(_fitted(true, seconds, amplitude=size).solve(0, 0.0, dead_zones=False).weights)
        for seconds, size in ((3.0, 0.05), (25.0, 0.8))
    ]
    # the handle went 0.1 rad through a loop of 0.8: no more than twice that is claimed
    assert widths[0] < 0.2 < 0.9 * _width(true) < widths[1]
    nothing = IncrementFit().solve(0, 0.0, dead_zones=True)
    assert _width(nothing.weights) < 0.02
    assert nothing.width_std > 0.2  # as good as unknown


def test_the_standard_deviation_of_the_width_is_honest() -> None:
    """The truth lies within two of them on nine plants of ten, with runs long and short."""
    random = np.random.default_rng(3)
    within = []
    for seed in range(24):
        true = np.zeros(COLUMNS)
        chosen = random.choice(PLAYS, 3, replace=False)
        true[chosen] = random.dirichlet(np.ones(3)) * random.uniform(0.8, 1.0)
        seconds = float(random.choice([8.0, 15.0, 25.0]))
        found = _fitted(true, seconds, seed=seed).solve(0, 0.0, dead_zones=False)
        within.append(abs(_width(found.weights) - _width(true)) < 2 * found.width_std)
    assert np.mean(within) >= 0.9


def test_discounted_evidence_gives_way_to_new() -> None:
    old, new = _weights(c2=0.9), _weights(c8=0.9)
    kept, discounted = _fitted(old), _fitted(old)
    discounted.discount(0.1)
    assert discounted.count == pytest.approx(0.1 * kept.count)
    assert discounted.solve(0, 0.0, dead_zones=False).weights == pytest.approx(
        kept.solve(0, 0.0, dead_zones=False).weights, abs=0.1
    )  # by itself it only weighs the prior more
    later = _fitted(new, 15.0, seed=5)
    errors = []
    for fit in (kept, discounted):
        for name in ("_xx", "_xy", "_yy", "_noise"):
            setattr(fit, name, getattr(fit, name) + getattr(later, name))
        fit.count += later.count
        errors.append(abs(_width(fit.solve(0, 0.0, dead_zones=False).weights) - _width(new)))
    assert errors[1] < 0.5 * errors[0]


def test_what_did_not_move_is_said() -> None:
    fit = IncrementFit()
    assert fit.moved(0) == fit.turned(1) == 0.0
    fit = _fitted(_weights(c4=0.9))
    assert fit.moved(0) > fit.turned(0) > 0.01
