"""The model in use: its axes, its widths, and from when on its bends are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.control.predictive import predictive_memory
from endolock.control.predictive.capstan_rollout import CapstanRollout
from endolock.control.predictive.handle_history import HALF_WIDTHS, PRIOR
from endolock.control.predictive.model_in_use import UNKNOWN_RAD, WIDTHS_EVERY_S, ModelInUse
from endolock.control.predictive.online_capstan import START, Search
from endolock.control.predictive.predictive_settings import PredictiveSettings
from endolock.control.predictive.seen_frames import SeenFrame
from endolock.hw.api import Vector

DT = 0.02
NARROW, WIDE = 2, 8
"""Columns of plays of 0.1 and 0.4 rad."""


def _follow(model: ModelInUse, seconds: float, from_s: float = 0.0) -> None:
    """Move both handles to and fro."""
    for n in range(1, round(seconds / DT) + 1):
        t = from_s + n * DT
        model.follow(t, (0.7 * float(np.sin(1.1 * t)), 0.6 * float(np.sin(0.8 * t))))


def _use_capstan(model: ModelInUse, t: float, video_rad: float = 0.0) -> None:
    """Let the model use a capstan at rest from a time on [s]."""
    found = START._replace(video_turn_rad=video_rad)
    model.capstan.search = Search(found)
    model.capstan.followed = CapstanRollout(found, ([], []))
    model.capstan._kept = [(t, ([], []))]
    model.capstan_used = True


def _model(*columns: int) -> ModelInUse:
    """A model of one play per axis."""
    model = ModelInUse(0.0, (0.0, 0.0))
    weights = np.zeros((2, len(PRIOR)))
    weights[[0, 1], list(columns)] = PRIOR[0]
    model.weights = weights
    return model


@given(st.floats(-0.3, 0.3), st.booleans())
def test_bends_in_axes_of_the_wires_are_those_of_the_video_turned_back(
    video_rad: float, capstan: bool
) -> None:
    model = _model(NARROW, WIDE)
    model.turn_rad = 0.0 if capstan else video_rad
    if capstan:
        _use_capstan(model, 0.0, video_rad)
    _follow(model, 1.0)
    times = np.array([0.5, model.history.times[-1]])
    in_video = model.bends_at(times)
    assert model.to_wires(in_video)[-1] == pytest.approx(model.bend)
    assert model.to_wires(in_video[-1]) == pytest.approx(model.bend)  # one bend as well as many
    # positive angles go from axes of the video to those of the wires
    first, second = complex(*model.bend), complex(*in_video[-1])
    assert np.angle(first / second) == pytest.approx(video_rad, abs=1e-9)


def test_the_inverse_takes_bends_in_axes_of_the_wires() -> None:
    model = _model(NARROW, WIDE)
    model.turn_rad = 0.25
    _follow(model, 3.0)
    up_down, left_right = (model.bend + [0.1, 0.0]).tolist()
    handles = model.handles_for((up_down, left_right), np.pi)
    assert handles[0] != model.history.handles[0]
    assert handles[1] == model.history.handles[1]  # whatever the video's axes are


@pytest.mark.parametrize("unknown", [(False, False), (True, False), (False, True), (True, True)])
def test_an_unknown_width_is_taken_from_the_other_axis(unknown: tuple[bool, bool]) -> None:
    """If that is wider; one that is known is its own."""
    for columns in ((NARROW, WIDE), (WIDE, NARROW)):
        model = _model(*columns)
        model.width_std = np.where(unknown, 1.01 * UNKNOWN_RAD, 0.99 * UNKNOWN_RAD)
        own = 2 * HALF_WIDTHS[list(columns)]
        assert model.widths == pytest.approx(own)
        assert model.likely_widths == pytest.approx(np.where(unknown, own.max(), own))


def test_with_the_capstan_widths_are_its_dead_bands() -> None:
    model = _model(NARROW, WIDE)
    _follow(model, 5.0)
    _use_capstan(model, 5.0)
    _follow(model, DT, from_s=5.0)
    up_down, left_right = model.history.handles.tolist()
    widths = np.array(model.capstan.widths((up_down, left_right)))
    assert model.likely_widths == pytest.approx(widths)
    _follow(model, WIDTHS_EVERY_S - 2 * DT, from_s=5.0 + DT)
    assert model.likely_widths == pytest.approx(widths)  # they are computed now and then
    _follow(model, 2 * DT, from_s=5.0 + WIDTHS_EVERY_S - DT)
    assert model.likely_widths != pytest.approx(widths)
    assert (model.likely_widths > 0.1).all()  # loops of a common endoscope are 0.5 rad wide


def test_bends_of_a_capstan_are_known_from_its_start_on() -> None:
    model = _model(NARROW, WIDE)
    _follow(model, 3.0)
    assert model.since_s == 0.0
    _use_capstan(model, 3.0)
    _follow(model, 2.0, from_s=3.0)
    assert model.since_s == pytest.approx(3.0 + DT)
    model.capstan_used = False
    assert model.since_s == 0.0


def test_a_state_that_comes_twice_moves_no_model_along() -> None:
    """Else the bends of the capstan would belong to later ticks than they are taken for."""
    once, twice = _model(WIDE, WIDE), _model(WIDE, WIDE)
    for model in (once, twice):
        _follow(model, 2.0)
        _use_capstan(model, 2.0)
    for n in range(1, 101):
        t = 2.0 + n * DT
        handles = 0.4 * float(np.sin(3 * t)), 0.3 * float(np.cos(2 * t))
        once.follow(t, handles)
        for _ in range(2):
            twice.follow(t, handles)
    times = np.linspace(2.5, 4.0, 40)
    assert twice.bends_at(times).tolist() == once.bends_at(times).tolist()


def test_errors_of_a_new_model_are_told_of_times_at_which_its_bends_are_known() -> None:
    """Measured are the bends of the capstan itself, so that it has no error to be predicted."""
    memory = predictive_memory.fresh(PredictiveSettings(), 0.0, (0.0, 0.0))
    model = memory.model
    model.background = True
    _follow(model, 3.0)
    before = model.bend
    _use_capstan(model, 3.0)
    _follow(model, 2.0, from_s=3.0)
    for t in np.arange(0.5, 4.9, 0.04).tolist():
        at = np.array([t])
        true: Vector = model.history.angles[np.searchsorted(model.history.times, t)]
        bend = model.bends_at(at)[0] if t > model.since_s else true
        columns = model.history.columns_at(at)[0]
        model.frames.append(SeenFrame(t, bend, np.zeros(2), columns, True))
    memory.model_changed(before, noise_px=0.5)
    assert memory.error.at(5.2) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert np.abs(memory.error._past.places).max() < 1e-6
    assert memory.error._past.times[0] >= model.since_s
