"""The capstan model while the lock runs: what it follows is what it was found to be."""

from __future__ import annotations

import numpy as np
import pytest

from endolock.control.predictive.capstan_model import LONG_S, STEPS, CapstanModel
from endolock.control.predictive.capstan_rollout import CapstanParameters, CapstanRollout
from endolock.control.predictive.handle_history import HandleHistory
from endolock.control.predictive.online_capstan import START

DT, FRAME_S, KNOT_S = 0.02, 0.04, 6.0
TRUE = CapstanParameters(
    **{**START._asdict(), "conduit_exponent": 0.7, "section_friction": 0.2, "slack_m": -3e-3}
)


def _followed(seconds: float) -> tuple[CapstanModel, HandleHistory, np.ndarray]:
    """Measured bends of a plant of its kind, minus which nothing is left; the true bends."""
    turns = np.random.default_rng(1).uniform(-0.9, 0.9, (60, 2))
    model, history = CapstanModel(), HandleHistory((0.0, 0.0))
    plant = CapstanRollout(TRUE, ([], []))
    rows: list[tuple[float, float, float]] = []
    for n in range(int(seconds / DT)):
        t = n * DT
        first, second = (float(np.interp(t, np.arange(60), column)) for column in turns.T)
        history.follow(t, (first, second))
        model.follow(history)
        plant.follow([(first, second)])
        bend = plant.bends[-1]
        if n % 2 == 0:
            rows.append((t, -bend[0], -bend[1]))
        model.work(history, np.array(rows), KNOT_S)
    return model, history, np.array(plant.bends)


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


def test_forgetting_starts_the_search_again_from_what_was_found() -> None:
    model, _, _ = _followed(15.0)
    parameters = model.search.parameters
    model.forget()
    assert model.search.parameters == parameters
    assert model.search.steps == 0
    assert model.idle
