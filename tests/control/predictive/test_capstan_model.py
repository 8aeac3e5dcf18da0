"""The capstan model while the lock runs: what it follows is what it was found to be."""

from __future__ import annotations

import numpy as np
import pytest

from endolock.control.predictive.capstan_model import (
    LONG_S,
    NUDGE_RAD,
    STEPS,
    CapstanModel,
)
from endolock.control.predictive.capstan_rollout import CapstanParameters, CapstanRollout
from endolock.control.predictive.handle_history import HandleHistory
from endolock.control.predictive.online_capstan import START
from endolock.control.transmission.kinematics import Pair

DT, FRAME_S, KNOT_S = 0.02, 0.04, 6.0
TRUE = CapstanParameters(
    **{**START._asdict(), "conduit_exponent": 0.7, "section_friction": 0.2, "slack_m": -3e-3}
)


class Runner:
    """Handles on random strokes, a plant of the model's kind, and the model that sees its bends."""

    def __init__(self) -> None:
        self.model, self.history = CapstanModel(), HandleHistory((0.0, 0.0))
        self.plant = CapstanRollout(TRUE, ([], []))
        self.turns = np.random.default_rng(1).uniform(-0.9, 0.9, (60, 2))
        self.rows: list[tuple[float, float, float]] = []
        self.n = 0

    def run(self, seconds: float) -> CapstanModel:
        """Go on; measured are the bends, minus which nothing is left."""
        for _ in range(round(seconds / DT)):
            t = self.n * DT
            first, second = (float(np.interp(t, np.arange(60), one)) for one in self.turns.T)
            self.history.follow(t, (first, second))
            self.model.follow(self.history)
            self.plant.follow([(first, second)])
            bend = self.plant.bends[-1]
            if self.n % 2 == 0:
                self.rows.append((t, -bend[0], -bend[1]))
            self.model.work(self.history, np.array(self.rows), KNOT_S)
            self.n += 1
        return self.model

    def rub(self, times: float) -> None:
        """Multiply the friction by a factor [1]."""
        changed = TRUE._replace(
            conduit_exponent=times * TRUE.conduit_exponent,
            section_friction=times * TRUE.section_friction,
        )
        self.plant = CapstanRollout(changed, self.plant.states, self.plant.bends)


def _followed(seconds: float) -> tuple[CapstanModel, HandleHistory, np.ndarray]:
    """The model after a time, and the true bends."""
    runner = Runner()
    return runner.run(seconds), runner.history, np.array(runner.plant.bends)


@pytest.fixture(scope="module")
def followed() -> tuple[CapstanModel, HandleHistory, np.ndarray]:
    """The model after 40 s."""
    return _followed(40.0)


def test_nothing_is_followed_at_first() -> None:
    model, history, _ = _followed(3.0)
    assert model.followed is None
    assert len(model.bends) == 0
    assert not model.ready(history)


def test_it_finds_and_follows_a_plant_of_its_kind(
    followed: tuple[CapstanModel, HandleHistory, np.ndarray],
) -> None:
    model, history, true = followed
    assert model.ready(history)
    assert model.search.steps >= STEPS
    assert history.times[-1] - history.times[-len(model.bends)] > LONG_S
    late = model.bends[-500:] - true[-500:]
    # the drift that the knots leave open is not the model's to say
    assert np.std(late, axis=0).max() < 0.1 * np.std(true[-500:])


def test_past_bends_are_those_of_the_ticks(
    followed: tuple[CapstanModel, HandleHistory, np.ndarray],
) -> None:
    model, history, _ = followed
    times = history.times[-50:]
    assert model.bends_at(history, times) == pytest.approx(model.bends[-50:])


def test_the_inverse_gives_the_bend(
    followed: tuple[CapstanModel, HandleHistory, np.ndarray],
) -> None:
    model, history, _ = followed
    assert model.followed
    up_down, left_right = history.handles.tolist()
    present = model.bends[-1]
    wanted = float(present[0]) + 0.1, float(present[1]) - 0.1
    handles = model.handles_for(wanted, (up_down, left_right))
    ahead = CapstanRollout(model.followed.parameters, model.followed.states)
    steps = np.linspace((up_down, left_right), handles, 20)[1:]
    ahead.follow([(a, b) for a, b in steps.tolist()])
    # each axis is inverted at the present bend of the other
    assert ahead.bends[-1] == pytest.approx(wanted, abs=0.03)


def test_widths_are_the_dead_bands_of_the_model(
    followed: tuple[CapstanModel, HandleHistory, np.ndarray],
) -> None:
    model, history, _ = followed
    up_down, left_right = history.handles.tolist()
    widths = model.widths((up_down, left_right))
    for axis, width in enumerate(widths):
        assert width == pytest.approx(_dead_band(model, (up_down, left_right), axis), abs=2 * NUDGE)


NUDGE = 1e-3
"""Steps of a handle with which its dead band is measured [rad]."""


def _dead_band(model: CapstanModel, handles: Pair, axis: int) -> float:
    """Way of one handle from a bend `NUDGE_RAD` below the present one to one as far above."""
    assert model.followed
    present, way = float(model.bends[-1][axis]), 0.0
    for sign in (1, -1):
        ahead, at = CapstanRollout(model.followed.parameters, model.followed.states), list(handles)
        while not ahead.bends or sign * (ahead.bends[-1][axis] - present) < NUDGE_RAD:
            at[axis] += sign * NUDGE
            ahead.follow([(at[0], at[1])])
        way += NUDGE * len(ahead.bends)
    return way


def test_a_new_window_starts_from_a_state_of_the_past() -> None:
    """As if all of the past had been simulated with the parameters that were found."""
    runner = Runner()
    while runner.model.search.steps == 0 or runner.model.search.window is None:
        runner.run(DT)
    model, window = runner.model, runner.model.search.window
    assert window
    assert model.followed
    assert model.followed.parameters == model.search.parameters
    first = int(np.searchsorted(runner.history.times, window.ticks[0]))
    assert first > 0
    angles = [(a, b) for a, b in runner.history.angles.tolist()]
    whole = CapstanRollout(model.search.parameters, ([], []))
    whole.follow(angles[: first + 100])
    goes_on = CapstanRollout(model.search.parameters, window.states)
    goes_on.follow(angles[first : first + 100])
    # windows are simulated with steps of 0.02 rad or more: a pixel
    assert np.array(goes_on.bends) == pytest.approx(np.array(whole.bends[first:]), abs=0.004)


def test_before_anything_is_found_a_change_leaves_the_search_going() -> None:
    runner = Runner()
    model = runner.model
    while model.search.window is None:
        runner.run(DT)
    search, window = model.search, model.search.window
    assert search.steps == 0
    model.changed(runner.n * DT - 1.0, measured=True)
    assert model.search is search
    assert model.search.window is window


def test_after_a_change_the_search_starts_again_from_what_was_found() -> None:
    runner = Runner()
    model = runner.run(20.0)
    found, followed = model.search.parameters, model.followed
    assert model.search.steps > 0
    model.changed(19.0, measured=True)
    assert model.search.parameters == model.search.prior == found
    assert model.search.steps == 0
    assert model.idle
    assert model.followed is followed  # until a better one is found
    assert not model.ready(runner.history)


def test_after_a_change_only_frames_since_then_count() -> None:
    """From the newest stored state before it on, with a model soon, and its bends no further."""
    runner = Runner()
    model = runner.run(20.0)
    change_s = 19.0
    model.changed(change_s, measured=True)
    runner.rub(2.0)
    while model.search.window is None:
        runner.run(DT)
    window = model.search.window
    assert window.frames[0][0] > change_s
    # states are stored every second, but not while a model that was found catches up
    assert change_s - 4.0 < window.ticks[0] <= change_s + DT
    while model.search.steps == 0 or not model.idle:
        runner.run(DT)
    assert model.ready(runner.history)
    assert (
        runner.n * DT < 24.0
    )  # seconds after the change, not the turns that the first search took
    assert runner.history.times[-len(model.bends)] == pytest.approx(window.ticks[0])
