"""The model in use: its axes and its widths."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.control.predictive.capstan_rollout import CapstanRollout
from endolock.control.predictive.handle_history import HALF_WIDTHS, PRIOR
from endolock.control.predictive.model_in_use import UNKNOWN_RAD, WIDTHS_EVERY_S, ModelInUse
from endolock.control.predictive.online_capstan import START, Search

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
