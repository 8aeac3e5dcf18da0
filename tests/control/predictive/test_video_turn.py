"""Rotation of the video about its axis: found from increments, and no reason to move a handle."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import cos, sin

import numpy as np
import pytest

from endolock.control import loop, registry
from endolock.control.predictive import model_belief
from endolock.control.predictive.capstan_model import rotation
from endolock.control.predictive.handle_history import COLUMNS, HALF_WIDTHS, PRIOR, HandleHistory
from endolock.control.predictive.increment_fit import MOST_TURN_RAD, SHIFTS_S, IncrementFit
from endolock.control.predictive.predictive_lock import Predictive
from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Vector
from endolock.scripts.runs import rigs
from endolock.scripts.runs.experiment import Experiment

FRAME_S = 0.04
NOISE_RAD = 2e-4
"""Noise of an increment: that of turns measured on pictures, docs/vision.md."""
PLAY, TWO = np.zeros(COLUMNS), np.zeros(COLUMNS)
PLAY[6] = 0.9
TWO[[2, 8]] = 0.3, 0.6
TURNS = np.random.default_rng(1).uniform(-0.8, 0.8, (40, 2))


def _strokes(t: float) -> Pair:
    """Strokes of random sizes on both handles."""
    first, second = (float(np.interp(t, np.arange(40), column)) for column in TURNS.T)
    return first, second


def _one(t: float) -> Pair:
    """One handle at rest."""
    return 0.0, _strokes(t)[1]


def _circle(t: float) -> Pair:
    return 0.7 * sin(1.3 * t), 0.7 * cos(1.3 * t)


def _evidence(handles: Callable[[float], Pair], weights: Vector, video_rad: float) -> IncrementFit:
    """Half a minute of a plant with the same weights on both axes, in a rotated video."""
    history, fit = HandleHistory(handles(0.0)), IncrementFit()
    for t in np.arange(0.0, 25.0, 0.02).tolist():
        history.follow(t, handles(t))
    random = np.random.default_rng(0)
    for before, t in pairwise(np.arange(0.5, 24.5, FRAME_S)):
        columns = history.columns_at(t + SHIFTS_S) - history.columns_at(before + SHIFTS_S)
        bend = columns[len(SHIFTS_S) // 2] @ weights @ rotation(video_rad)
        bend += NOISE_RAD * random.standard_normal(2)
        fit.add(columns, bend, np.full(2, NOISE_RAD**2), FRAME_S)
    return fit


def _found(fit: IncrementFit, calls: int = 40) -> float:
    turn = 0.0
    for _ in range(calls):
        turn = fit.look_for_turn(0.0, True, turn)
    return turn


@pytest.mark.parametrize("video_rad", [-0.25, -0.1, 0.0, 0.1, 0.25])
@pytest.mark.parametrize("weights", [PRIOR, PLAY, TWO], ids=["no loop", "one play", "two plays"])
@pytest.mark.parametrize("handles", [_strokes, _one], ids=["both handles", "one handle"])
def test_the_rotation_is_found(
    handles: Callable[[float], Pair], weights: Vector, video_rad: float
) -> None:
    # its prior, of 0.1 rad, weighs little against half a minute
    assert _found(_evidence(handles, weights, video_rad)) == pytest.approx(video_rad, abs=0.005)


@pytest.mark.parametrize("video_rad", [-0.2, 0.0, 0.2])
@pytest.mark.parametrize("weights", [PLAY, TWO], ids=["one play", "two plays"])
def test_on_a_circle_a_loop_is_no_rotation(weights: Vector, video_rad: float) -> None:
    """Both turn the circle of the bends, by 0.4 rad for this loop; the corners tell them apart."""
    fit = _evidence(_circle, weights, video_rad)
    turn = _found(fit)
    assert turn == pytest.approx(video_rad, abs=0.03)
    for axis in range(2):
        found = fit.solve(axis, 0.0, True, turn).weights
        width, true = (2 * w @ HALF_WIDTHS / w.sum() for w in (found, weights))
        assert width == pytest.approx(true, abs=0.05)


@pytest.mark.parametrize("sign", [-1, 1])
def test_the_search_stays_within_its_bounds_and_moves_by_small_steps(sign: int) -> None:
    fit, turns = _evidence(_strokes, PLAY, 0.6 * sign), [0.0]
    for _ in range(40):
        turns.append(fit.look_for_turn(0.0, True, turns[-1]))
    assert np.abs(np.diff(turns)).max() <= 0.04 + 1e-12
    assert turns[-1] == pytest.approx(sign * MOST_TURN_RAD)


def test_without_evidence_the_video_is_not_rotated() -> None:
    assert _found(IncrementFit()) == 0.0


@pytest.mark.parametrize("video_rad", [-0.25, 0.25])
def test_the_background_is_believed_though_one_handle_rests(video_rad: float) -> None:
    """The bend moves along both axes of the video then, and the resting handle explains nothing."""
    fit = _evidence(_one, PLAY, video_rad)
    assert min(fit.turned(axis) for axis in range(2)) > model_belief.TURN_RAD**2
    for turn in (0.0, _found(fit)):  # before and after it is found
        assert model_belief.handles_explain(fit, 0.0, turn)


@pytest.mark.parametrize("video_rad", [-0.2, 0.2])
def test_the_handle_that_need_not_move_rests_in_a_rotated_video(video_rad: float) -> None:
    """The target moves along one axis of the wires, and along both of the video."""
    task = Experiment(
        scenario="straight",
        vision="truth",
        vary=("camera.truth_noise_px=0.3", f"instrument.misalignment_rad={video_rad}"),
        duration_s=18.0,
        rig="play",
    ).resolve()
    rig, eyes = rigs.make("play", task.scenario, vision="truth", instrument=task.instrument, seed=0)
    with rig:
        lock = registry.make("predictive_bank", rig.camera.calibration)
        assert isinstance(lock, Predictive)
        run = loop.run(rig, eyes, lock, duration_s=18.0)
    assert lock.memory.model.turn_rad == pytest.approx(video_rad, abs=0.02)
    handles = np.array([tick.state.position for tick in run.ticks if tick.t > 11.0])
    up_down, left_right = np.ptp(handles, axis=0)
    assert left_right > 0.5
    # a few steps of the encoders; along axes of the video it would be a fifth of the other's
    assert up_down < 0.01
