"""Prediction of the target: learnt from any regular motion, never worse than that it stays."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi, sin

import numpy as np
import pytest

from endolock.control.predictive.prediction import TargetPrediction
from endolock.control.transmission.kinematics import Pair

FRAME_S = 0.04
HORIZON_S = 0.48
PX = 0.7 / 262
"""A pixel in bend at 12 cm [rad]: the bend changes by 0.7 of the angle of view."""


def fresh(*, harmonic: bool = True, regression: bool = True) -> TargetPrediction:
    return TargetPrediction(
        walk_density=0.02, densities=(0.02, 0.5), harmonic=harmonic, regression=regression
    )


def errors(
    prediction: TargetPrediction,
    path: Callable[[float], Pair],
    seconds: float,
    noise: float,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Feed a path; return errors (frames, 2) of the prediction and of "it stays" [px]."""
    random = np.random.default_rng(seed)
    off, stays = [], []
    for t in np.arange(0.0, seconds, FRAME_S).tolist():
        x, y = path(t)
        dx, dy = (noise * PX * random.standard_normal(2)).tolist()
        prediction.update(t, (x + dx, y + dy), ((noise * PX) ** 2,) * 2, HORIZON_S)
        prediction.work()
        prediction.work()
        true = np.array(path(t + HORIZON_S))
        off.append(prediction.at(t + HORIZON_S) - true)
        stays.append(prediction.stays_at() - true)
    return np.array(off) / PX, np.array(stays) / PX


def rms(off: np.ndarray) -> float:
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def two_periods(t: float) -> Pair:
    return 0.2 * sin(2 * pi * t / 7.7), 0.15 * cos(2 * pi * t / 10.9 + 1)


def test_a_period_of_its_own_is_found_on_each_axis() -> None:
    off, _ = errors(fresh(regression=False), two_periods, 40.0, 0.3)
    assert rms(off[-250:]) < 1.0  # three times the noise; a shared period leaves tens of pixels


def test_the_regression_alone_predicts_incommensurable_motions_of_one_axis() -> None:
    def breath(t: float) -> Pair:
        return 0.05 * sin(2 * pi * 0.27 * t) + 0.006 * sin(2 * pi * 1.13 * t), 0.0

    off, stays = errors(fresh(harmonic=False), breath, 25.0, 0.3)
    assert rms(off[-250:]) < 1.0  # three times the noise
    assert rms(stays[-250:]) > 5.0


@pytest.mark.parametrize("seed", [3, 4])
def test_a_random_walk_is_predicted_to_stay(seed: int) -> None:
    steps = np.random.default_rng(seed).standard_normal((1000, 2)) * 0.006
    walk = np.cumsum(steps, axis=0)
    off, stays = errors(
        fresh(), lambda t: tuple(walk[min(round(t / FRAME_S), 999)].tolist()), 35.0, 0.3
    )
    assert rms(off[100:]) < 1.05 * rms(stays[100:])  # nothing predicts it better


def test_moving_the_past_moves_the_prediction_and_nothing_else() -> None:
    one, other = fresh(), fresh()
    errors(one, two_periods, 20.0, 0.3)
    errors(other, two_periods, 20.0, 0.3)
    other.move((0.03, -0.02))
    t = 20.0 - FRAME_S + HORIZON_S
    expected = one.at(t)[0] + 0.03, one.at(t)[1] - 0.02
    assert other.at(t) == pytest.approx(expected, abs=1e-12)
    assert other.weights == one.weights
    assert other.error_rad == one.error_rad
