"""The model of the transmission inside the lock: what it believes, and when it changes its mind."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi, sin
from typing import Any

import numpy as np
import pytest

from endolock.control.predictive.handle_history import PLAYS
from endolock.control.predictive.seen_frames import SeenFrame, right_jacobian
from endolock.control.predictive.transmission_model import TransmissionModel
from endolock.control.transmission.kinematics import Pair
from endolock.control.transmission.plays import Plays
from endolock.hw.api import Vector
from endolock.twin.physics.foreign_plants import BoucWen, DeadZone, PlayBehindDeadZone
from endolock.vision.observation import Turn

DT = 0.02
NOISE_RAD = 1e-4
WIDE = Plays(weights=(0.9,), radii=(0.4,))
NARROW = Plays(weights=(0.9,), radii=(0.1,))


class Runner:
    """Handles on random strokes, a plant, its turns, and the model that sees them."""

    def __init__(self, plant: Any, *, capstan: bool = False, seed: int = 0) -> None:
        self.model = TransmissionModel(
            0.0, (0.0, 0.0), capstan=capstan, dead_zones=True, background=True
        )
        self.axes = plant.at_rest()
        self.random = np.random.default_rng(seed)
        self.turns = self.random.uniform(-0.9, 0.9, (200, 2))
        self.n = 0
        self.bend, self.seen_s = np.zeros(2), 0.0
        self.errors: list[Vector] = []
        self.paths: list[Vector] = []
        self.background: list[bool] = []

    def run(
        self,
        seconds: float,
        turned: Callable[[float, Vector], Vector | None] = lambda _t, change: change,
    ) -> TransmissionModel:
        """Go on, with what the background shows of the bend's change."""
        model = self.model
        for _ in range(round(seconds / DT)):
            self.n += 1
            t = self.n * DT
            handles = self._handles(t)
            model.follow(t, handles)
            bend = np.array(self.axes.follow(handles))
            if self.n % 2:
                continue
            shown = turned(t, bend - self.bend)
            turn = None if shown is None else self._turn(shown)
            tip = model.tip_at(t, turn)
            target = np.array([0.3 * sin(0.9 * t), 0.3 * cos(0.7 * t)])
            model.add(SeenFrame(t, tip.bend, target - bend, tip.columns, tip.turned))
            model.learn(t)
            model.work()
            self.bend, self.seen_s = bend, t
            self.errors.append(model.bend - bend)
            self.paths.append(np.array([handles, bend]))
            self.background.append(model.background)
        return model

    def unexplained(self, seconds: float) -> float:
        """Rms over the last seconds of what the model does not say of the bends, but constants."""
        return float(np.std(self.errors[-round(seconds / 2 / DT) :], axis=0).mean())

    def without_hysteresis(self, seconds: float) -> float:
        """The same of the best line from handle to bend."""
        handles, bends = np.moveaxis(np.array(self.paths[-round(seconds / 2 / DT) :]), 1, 0)
        lines = [
            np.polyval(np.polyfit(h, b, 1), h) for h, b in zip(handles.T, bends.T, strict=True)
        ]
        return float(np.std(bends - np.array(lines).T, axis=0).mean())

    def _handles(self, t: float) -> Pair:
        first, second = (float(np.interp(t, np.arange(200), column)) for column in self.turns.T)
        return first, second

    def _turn(self, change: Vector) -> Turn:
        vector = right_jacobian(self.bend)[:, :2] @ change
        x, y, z = (vector + NOISE_RAD * self.random.standard_normal(3)).tolist()
        var = NOISE_RAD**2
        return Turn(
            since_s=self.seen_s,
            vector=(x, y, z),
            covariance=((var, 0.0, 0.0), (0.0, var, 0.0), (0.0, 0.0, var)),
        )


@pytest.mark.parametrize("plant", [WIDE, NARROW, DeadZone(), PlayBehindDeadZone(), BoucWen()])
def test_any_hysteresis_is_learnt_with_a_background(plant: Any) -> None:
    runner = Runner(plant)
    model = runner.run(25.0)
    assert model.known
    # the play behind a dead zone is only near to a sum of both; the others leave a sixth
    assert runner.unexplained(10.0) < 0.4 * runner.without_hysteresis(10.0)


def test_at_first_there_is_no_hysteresis_and_nothing_is_known() -> None:
    model = TransmissionModel(0.0, (0.1, -0.2), capstan=True, dead_zones=True, background=True)
    for n in range(50):
        model.follow(DT * (n + 1), (0.1 + 0.01 * n, -0.2))
    assert not model.known
    assert model.widths.tolist() == [0.0, 0.0]
    assert model.bend == pytest.approx(model.slopes * model.history.handles)
    up_down, left_right = model.bend.tolist()
    assert model.handles_for((up_down, left_right), pi) == pytest.approx(model.history.handles)


def test_the_inverse_of_what_was_learnt_gives_the_bend() -> None:
    runner = Runner(WIDE)
    model = runner.run(10.0)
    for later, change in enumerate((0.1, -0.1, 0.4), 1):
        wanted = model.bend + change
        up_down, left_right = wanted.tolist()
        handles = model.handles_for((up_down, left_right), pi)
        model.follow(runner.n * DT + later, handles)
        assert model.bend == pytest.approx(wanted)


def test_turns_count_while_the_target_is_not_found() -> None:
    """A tip that is pushed, so that the handles do not tell; the target is seen in the last."""
    runner, step, count = Runner(WIDE), np.array([0.01, -0.005]), 5
    model = runner.run(10.0)
    before = model.frames[-1].bend
    for n in range(1, count + 1):
        t = runner.n * DT + 2 * n * DT
        up_down, left_right = model.history.handles.tolist()
        model.follow(t, (up_down, left_right))
        tip = model.tip_at(t, runner._turn(step))
        runner.bend, runner.seen_s = runner.bend + step, t
        assert tip.turned
        assert model.turned_rad == pytest.approx(step, abs=5 * NOISE_RAD)
    assert tip.bend - before == pytest.approx(count * step, abs=5 * NOISE_RAD * count**0.5)


@pytest.mark.parametrize("wrong", ["unrelated", "five times", "a fifth"])
def test_a_wrong_background_is_not_believed(wrong: str) -> None:
    """Turns of something else, or of a wrong scale: from two seconds of evidence on."""

    def turned(t: float, change: Vector) -> Vector:
        unrelated = 0.02 * np.array([cos(2.3 * t), sin(3.1 * t)])
        return {"unrelated": unrelated, "five times": 5 * change, "a fifth": change / 5}[wrong]

    runner = Runner(WIDE)
    model = runner.run(12.0, turned)
    assert not model.background
    assert not any(runner.background[-100:])


def test_a_right_background_is_believed_from_the_start_and_missed_for_a_second_at_most() -> None:
    runner = Runner(WIDE)
    runner.run(12.0)
    assert np.mean(runner.background[5:]) > 0.99
    model = runner.run(3.0, lambda _t, _change: None)
    assert not model.background
    assert runner.run(3.0).background


def test_without_a_background_loops_are_found_from_the_target_alone() -> None:
    runner = Runner(WIDE)
    model = runner.run(25.0, lambda _t, _change: None)
    assert model.known
    assert model.widths == pytest.approx([0.8, 0.8], rel=0.15)  # the splines absorb some of it
    assert (model.width_std < 0.2).all()


def test_it_forgets_when_the_friction_doubles() -> None:
    runner = Runner(Plays(weights=(0.9,), radii=(0.2,)))
    runner.run(20.0)
    assert runner.model.widths == pytest.approx([0.4, 0.4], abs=0.05)
    runner.axes.rub(2.0)
    model = runner.run(20.0)
    # evidence that only ages, with 30 s, would be half old by now, and the width in the middle
    assert (model.widths > 0.6).all()
    assert runner.unexplained(5.0) < 0.05


def test_the_capstan_is_not_kept_on_a_dead_zone() -> None:
    runner = Runner(DeadZone(), capstan=True)
    model = runner.run(45.0)
    assert not model.capstan_used
    assert runner.unexplained(10.0) < 0.02


def test_the_options_leave_candidates_out() -> None:
    runner = Runner(DeadZone())
    runner.model = TransmissionModel(
        0.0, (0.0, 0.0), capstan=False, dead_zones=False, background=False
    )
    model = runner.run(12.0)
    assert not model.background
    assert not model.capstan_used
    assert not model.weights[:, PLAYS:].any()
