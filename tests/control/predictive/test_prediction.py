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
    times: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Feed a path; return errors (frames, 2) of the prediction and of "it stays" [px]."""
    random = np.random.default_rng(seed)
    off, stays = [], []
    times = np.arange(0.0, seconds, FRAME_S) if times is None else times
    for t in times.tolist():
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


def strokes(t: float) -> Pair:
    return 0.3 * (1 - cos(2 * pi * t / 8.6)), 0.0


@pytest.mark.parametrize("horizon_s", [-0.1, -0.22, -0.5])
def test_with_exposures_believed_later_than_now_the_target_is_where_it_was_seen(
    horizon_s: float,
) -> None:
    prediction = fresh()
    for n in range(250):
        t = n * FRAME_S
        prediction.update(t, strokes(t), (PX**2,) * 2, horizon_s)
        prediction.work()
    # never further off than it moved within the same time
    moved = abs(strokes(t)[0] - strokes(t + horizon_s)[0])
    assert abs(prediction.at(t + horizon_s)[0] - strokes(t)[0]) < 2 * moved + PX


def jump(t: float) -> Pair:
    """2 cm within 1 s at 12 cm."""
    return 0.1 * min(max(t - 8.0, 0.0), 1.0), 0.0


@pytest.mark.parametrize("noise", [0.3, 3.0])
def test_a_jump_is_not_overshot(noise: float) -> None:
    off, stays = errors(fresh(), jump, 16.0, noise, seed=5)
    worst, worst_stays = np.abs(off).max(), np.abs(stays).max()
    # Any prediction of motion misses the stop as "it stays" misses the start. No displacement is
    # predicted that is above 1.2 of those seen; the noise comes on top.
    assert worst < 1.2 * worst_stays + 2 * noise
    later = slice(round((9.0 + 2 * HORIZON_S) / FRAME_S), None)
    assert rms(off[later]) < 1.05 * rms(stays[later]) + 1  # it knows again that the target stays


def test_a_prediction_from_cold_is_useful_within_three_seconds() -> None:
    def course(t: float) -> Pair:
        return 0.3 * cos(2 * pi * t / 20.0), 0.3 * sin(2 * pi * t / 20.0)

    off, stays = errors(fresh(), course, 10.0, 0.3)
    assert rms(off[38:75]) < 0.5 * rms(stays[38:75])  # 1.5 to 3 s
    assert np.abs(off).max() < 1.1 * np.abs(stays).max()  # and never wild


@pytest.mark.parametrize("kind", ["dropped", "jittered"])
def test_dropped_and_uneven_frames_cost_little(kind: str) -> None:
    random = np.random.default_rng(6)
    times = np.arange(0.0, 35.0, FRAME_S)
    if kind == "dropped":
        times = times[random.random(len(times)) > 0.2]
    else:
        times = np.sort(times + random.uniform(0, 0.08, len(times)))
    off, _ = errors(fresh(), two_periods, 0.0, 0.3, times=times)
    assert rms(off[-200:]) < 1.5  # 2.5 px is the noise of two axes at 1 px; a velocity leaves 7


def test_after_a_gap_it_continues_sensibly() -> None:
    times = np.arange(0.0, 34.0, FRAME_S)
    times = times[(times < 30.0) | (times > 32.4)]
    prediction = fresh()
    off, stays = errors(prediction, strokes, 0.0, 0.3, times=times)
    after = slice(int(np.searchsorted(times, 32.0)), None)
    assert np.abs(off[after]).max() < 0.5 * np.abs(stays[after]).max()
    # far beyond what is asked for it stays bounded: the path spans 0.6 rad
    assert abs(prediction.at(37.0)[0] - 0.3) < 0.6


@pytest.mark.parametrize("noise", [0.3, 1.0])
def test_the_expected_error_is_that_found(noise: float) -> None:
    random = np.random.default_rng(7)
    shocks = random.standard_normal((1600, 2))
    wander = np.zeros((1600, 2))  # noise through a second-order low-pass at 0.3 Hz
    state, w = np.zeros((2, 2)), 2 * pi * 0.3
    for n in range(1, 1600):
        state[1] += FRAME_S * (-(2**0.5) * w * state[1] - w * w * state[0]) + 0.04 * shocks[n]
        state[0] += FRAME_S * state[1]
        wander[n] = state[0]

    def path(t: float) -> Pair:
        n = min(int(t / FRAME_S + 1e-9), 1598)
        part = t / FRAME_S - n
        x, y = ((1 - part) * wander[n] + part * wander[n + 1]).tolist()
        return x, y

    prediction, expected, found = fresh(), [], []
    for n in range(1500):
        t = n * FRAME_S
        seen = np.array(path(t)) + noise * PX * random.standard_normal(2)
        prediction.update(t, (float(seen[0]), float(seen[1])), ((noise * PX) ** 2,) * 2, HORIZON_S)
        prediction.work()
        prediction.work()
        if n > 500:
            expected.append(np.square(prediction.error_rad).sum())
            found.append(np.square(np.array(prediction.at(t + HORIZON_S)) - path(t + HORIZON_S)))
    ratio = (np.mean(expected) / np.sum(found, axis=1).mean()) ** 0.5
    assert 0.8 < ratio < 1.25  # of 40 s with a correlation time of about one


def test_the_same_past_written_again_changes_nothing() -> None:
    prediction = fresh()
    random = np.random.default_rng(8)
    times = np.arange(0.0, 30.0, FRAME_S).tolist()
    places = []
    for t in times:
        x, y = two_periods(t)
        dx, dy = (0.3 * PX * random.standard_normal(2)).tolist()
        places.append((x + dx, y + dy))
        prediction.update(t, places[-1], ((0.3 * PX) ** 2,) * 2, HORIZON_S)
        prediction.work()
        prediction.work()
    before, weights, error = prediction.at(30.4), prediction.weights, prediction.error_rad
    prediction.rewrite(np.array(times), np.array(places), ((0.3 * PX) ** 2,) * 2)
    # the regression learns from every fourth row, and the periods end anew at the newest place
    assert prediction.at(30.4) == pytest.approx(before, abs=1.0 * PX)
    assert prediction.weights == weights
    assert prediction.error_rad == error


def test_a_preview_is_continuous_from_the_newest_place_on() -> None:
    prediction = fresh()
    errors(prediction, two_periods, 25.0, 0.3)
    newest = 25.0 - FRAME_S
    path = np.array([prediction.at(newest + n * 0.001) for n in range(830)])
    # at most 0.2 rad * 2 pi / 7.7 s = 0.16 rad/s; half as much again for the regression's noise
    assert np.abs(np.diff(path, axis=0)).max() < 0.25 * 0.001
    assert path[0] == pytest.approx(prediction.stays_at(), abs=2 * PX)
    for shares in prediction.weights:
        assert sum(shares.values()) == pytest.approx(1.0)
        assert min(shares.values()) >= 0


def test_bursts_gaps_and_any_horizon_never_shoot_away() -> None:
    random = np.random.default_rng(9)
    prediction, t = fresh(), 0.0
    for _ in range(600):
        t += random.choice([0.04, 0.001, 0.5, 3.0], p=[0.9, 0.05, 0.04, 0.01])
        x, y = random.uniform(-0.1, 0.1, 2).tolist()
        horizon_s = random.uniform(0.1, 1.5)
        prediction.update(t, (x, y), (1e-5, 1e-5), horizon_s)
        prediction.work()
        for found in prediction.at(t + horizon_s):
            # the span of the places, 0.2, times 1.2 from within 0.1, and 0.01 for the filter
            assert abs(found) < 0.1 + 1.2 * 0.2 + 0.01


@pytest.mark.parametrize("harmonic", [False, True])
def test_any_set_of_predictors_may_be_left_out(harmonic: bool) -> None:
    prediction = TargetPrediction(
        walk_density=0.02, densities=(), harmonic=harmonic, regression=False
    )
    assert prediction.at(1.0) == (0.0, 0.0)  # before the first place
    off, stays = errors(prediction, strokes, 6.0, 0.3)
    assert rms(off) < 1.05 * rms(stays)
