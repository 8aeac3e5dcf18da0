"""From desired bends to goals: the speed limit, the slack, and the start of foreseen turns."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from endolock.control.predictive import handle_motion
from endolock.control.predictive.handle_history import PRIOR
from endolock.control.predictive.handle_motion import SPEED_RAD_S
from endolock.control.predictive.model_in_use import ModelInUse
from endolock.control.predictive.reference_play import ReferencePlay
from endolock.control.transmission.kinematics import Pair

DT = 0.02
RADIUS = 6
"""Column of a play of 0.3 rad."""
STEP = SPEED_RAD_S * DT


def _model(*handles: float) -> ModelInUse:
    """A model with one play, after its handles were at angles [rad]."""
    model = ModelInUse(0.0, (0.0, 0.0))
    weights = np.zeros_like(model.weights)
    weights[:, RADIUS] = PRIOR[0]
    model.weights = weights
    for n, handle in enumerate(handles):
        model.follow(0.02 * (n + 1), (handle, handle))
    return model


def _plays(place: float, direction: float) -> tuple[ReferencePlay, ReferencePlay]:
    """Plays at a place that last moved in a direction."""
    made = []
    for _ in range(2):
        play = ReferencePlay(place - 0.5 * direction)
        play.follow(0.0, place + 0.02 * direction, place, dt=DT, slope=1.0, width=0.6)
        assert play.direction == direction
        made.append(play)
    return made[0], made[1]


def _next(model: ModelInUse, wanted: float, soon: float, direction: float = 1.0) -> Pair:
    first, second = model.history.handles.tolist()
    return handle_motion.next_goals(
        (first, second),
        model,
        _plays(wanted, direction),
        (wanted, wanted),
        (soon, soon),
        speeds=(SPEED_RAD_S, SPEED_RAD_S),
        dt=DT,
    )


def test_goals_approach_the_inverse_at_a_limited_speed() -> None:
    model = _model(0.0, 0.5)
    far, near = float(model.bend[0]) + 0.3, float(model.bend[0]) + 0.5 * STEP * PRIOR[0]
    assert _next(model, far, far) == pytest.approx((0.5 + STEP,) * 2)
    assert _next(model, near, near) == pytest.approx((0.5 + 0.5 * STEP,) * 2)


def test_goals_stay_within_half_a_turn() -> None:
    model = _model(0.0, pi - 0.01)
    wanted = float(model.bend[0]) + 1.0
    assert _next(model, wanted, wanted) == (pi, pi)


def test_a_small_excess_does_not_turn_a_handle_back() -> None:
    model = _model(0.0, 0.5)
    bend = float(model.bend[0])
    for excess, held in ((0.001, True), (0.1, False)):
        goals = _next(model, bend - excess, bend - excess)
        assert (goals == (0.5, 0.5)) is held


def test_a_foreseen_turn_starts_the_way_through_the_loop() -> None:
    model = _model(0.0, 0.5)
    bend = float(model.bend[0])
    back = _next(model, bend + 1e-6, bend - 0.05)
    assert back[0] < 0.5  # the bend is to rise a little still, but the loop is wide
    assert float(_after(model, back)) == pytest.approx(bend)  # within it nothing is lost


def _after(model: ModelInUse, goals: Pair) -> float:
    model.follow(9.0, goals)
    return float(model.bend[0])


def test_the_time_through_a_loop_is_bounded() -> None:
    narrow, wide = handle_motion.foreseen_s(np.array([0.19, 9.0]))
    assert narrow == pytest.approx(0.19 / SPEED_RAD_S)
    assert wide == handle_motion.LONGEST_S


def test_handles_hurry_far_from_the_target_and_when_unsure() -> None:
    assert handle_motion.speed(0.01, 0.001) == SPEED_RAD_S
    assert handle_motion.speed(-0.3, 0.001) == pytest.approx(2 * SPEED_RAD_S)
    assert handle_motion.speed(0.01, 0.036) == pytest.approx(3 * SPEED_RAD_S)
