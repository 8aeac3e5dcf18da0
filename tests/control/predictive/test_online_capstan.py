"""The capstan model inside the lock: its inverse and its search."""

from __future__ import annotations

from itertools import pairwise
from math import exp

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.control.predictive import online_capstan
from endolock.control.predictive.capstan_model import rotation
from endolock.control.predictive.capstan_rollout import CapstanParameters, CapstanRollout
from endolock.control.predictive.online_capstan import CABLE, START, Search
from endolock.control.transmission.quasi_static import Axis, Cable, Geometry
from endolock.hw.api import Vector
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.instrument_cable import cable_of

TIGHT = Cable(
    conduit_exponent=0.66, section_friction=0.2, stiffness=8e4, slack_m=-3e-3, sheath=0.05
)
TRUE = CapstanParameters(
    conduit_exponent=0.7,
    section_friction=0.2,
    log_stiffness=START.log_stiffness + 0.2,
    handle_gain=1.0,
    slack_m=-3e-3,
    video_turn_rad=0.05,
    shift_s=0.02,
)
"""A plant of the same kind as the model, with a rotated video."""


@given(
    st.lists(st.floats(-1.2, 1.2), min_size=1, max_size=6),
    st.floats(0.01, 0.06),
    st.sampled_from([-1, 1]),
    st.floats(-0.8, 0.8),
)
@settings(deadline=None)
def test_the_inverse_gives_the_bend(
    turns: list[float], further: float, sign: int, other: float
) -> None:
    axis = Axis(TIGHT, Geometry())
    at = 0.0
    for turn in turns:
        for handle in np.linspace(at, turn, 40)[1:].tolist():
            axis.follow(handle, 0.2, other)
        axis.follow(turn, 0.2, other)  # and stops
        at = turn
    desired = axis.bend_rad + sign * further
    handle = axis.handle_for(desired, 0.2, other)
    assert (handle - at) * sign > 0
    # the inverse has the section's friction at the desired bend, the model at the present one
    assert axis.follow(handle, 0.2, other) == pytest.approx(desired, abs=0.15 * further)


def test_a_restored_state_continues() -> None:
    first, second = Axis(TIGHT, Geometry()), Axis(TIGHT, Geometry())
    for handle in (0.3, 0.8, 0.1):
        first.follow(handle, 0.1, 0.2)
    second.state = first.state
    assert second.follow(0.4, 0.1, 0.2) == first.follow(0.4, 0.1, 0.2)


def _exercise(t: Vector) -> Vector:
    """Strokes of all sizes on one handle and a slow circle on the other, 2 x n [rad]."""
    turns = np.random.default_rng(1).uniform(-0.9, 0.9, 40)
    return np.column_stack([np.interp(t, np.arange(40.0), turns), 0.6 * np.sin(0.7 * t)])


def _frames(t: Vector, handles: Vector) -> list[tuple[float, float, float]]:
    """Frames of a smoothly moving target, with the plant `TRUE`."""
    rollout = CapstanRollout(TRUE, ([], []))
    rollout.follow([(a, b) for a, b in handles.tolist()])
    bends = np.array(rollout.bends)
    exposed = np.arange(4.0, float(t[-1]) - 0.5, 0.04)
    moments = exposed + TRUE.shift_s
    bend = np.column_stack([np.interp(moments, t, column) for column in bends.T])
    target = np.column_stack([0.3 * np.cos(0.8 * moments), 0.3 * np.sin(0.6 * moments)])
    c, s = np.cos(TRUE.video_turn_rad), np.sin(TRUE.video_turn_rad)
    off = (target - bend) @ np.array([[c, -s], [s, c]])  # rotated the other way
    return [(float(e), float(x), float(y)) for e, (x, y) in zip(exposed, off, strict=True)]


def _searched(steps: int) -> Search:
    t = np.arange(0.0, 27.0, 0.02)
    handles = _exercise(t)
    frames = _frames(t, handles)
    search = Search()
    for _ in range(steps):
        online_capstan.begin(search, t, handles, frames, ([], []))
        while search.window is not None:
            online_capstan.work(search)
    return search


def _bends(parameters: CapstanParameters) -> Vector:
    """Bends on strokes that no search has seen, without their mean, n x 2 [rad]."""
    t = np.arange(0.0, 20.0, 0.02)
    up_down, left_right = _exercise(t).T
    rollout = CapstanRollout(parameters, ([], []))
    rollout.follow(
        [(0.8 * b, -a) for a, b in zip(up_down.tolist(), left_right.tolist(), strict=True)]
    )
    bends = np.array(rollout.bends)
    centred: Vector = bends - bends.mean(axis=0)
    return centred


def test_the_search_identifies_the_bends_from_the_frames() -> None:
    search = _searched(14)
    assert search.misfit_rad < 0.003  # the splines' residual of the target
    # of bends of 0.3 rad rms: a pixel
    assert np.std(_bends(search.parameters) - _bends(TRUE), axis=0).max() < 0.004


def test_the_search_identifies_the_parameters_where_it_ends() -> None:
    search = _searched(30)
    # shapes are determined, the slope hardly: stiffness and slack compensate for each other
    assert search.parameters.conduit_exponent == pytest.approx(TRUE.conduit_exponent, abs=0.1)
    assert search.parameters[CABLE:] == pytest.approx(TRUE[CABLE:], abs=0.01)


def test_states_stored_along_a_window_are_those_of_the_simulation_from_its_start() -> None:
    t = np.arange(0.0, 12.0, 0.02)
    handles, found, search = _exercise(t), None, Search()
    online_capstan.begin(search, t, handles, _frames(t, handles), ([], []))
    window = search.window
    assert window
    while search.window is not None:
        found = online_capstan.work(search)
    assert found
    assert window.stored[-1] == (window.ticks[-1], found.states)
    again, done = CapstanRollout(found.parameters, ([], [])), 0
    for at, states in window.stored:
        samples = int(np.searchsorted(t[window.kept], at - 1e-9)) + 1
        again.follow(window.course[done:samples])
        done = samples
        assert again.states == states
    assert again.bends == found.bends


def _friction(parameters: CapstanParameters, times: float) -> CapstanParameters:
    return parameters._replace(
        conduit_exponent=times * parameters.conduit_exponent,
        section_friction=times * parameters.section_friction,
    )


@pytest.mark.parametrize("window_s", [1.5, 3.0])
@pytest.mark.parametrize("times", [2.0, 1.5, 0.5])
def test_changed_friction_is_found_from_a_short_window(times: float, window_s: float) -> None:
    """All else stays as it was found; the bend itself is measured, without noise."""
    t = np.arange(0.0, 12.0 + window_s, 0.02)
    handles = _exercise(t)
    first = int(np.searchsorted(t, 12.0 - 1e-9))
    before = CapstanRollout(TRUE, ([], []))
    before.follow([(a, b) for a, b in handles[:first].tolist()])
    after = CapstanRollout(_friction(TRUE, times), before.states)
    after.follow([(a, b) for a, b in handles[first:].tolist()])
    exposed = np.arange(12.0, float(t[-1]) - 0.06, 0.04)
    late = exposed + TRUE.shift_s
    bends = [np.interp(late, t[first:], column) for column in np.array(after.bends).T]
    off = -np.column_stack(bends) @ rotation(TRUE.video_turn_rad)
    frames = [(e, a, b) for e, (a, b) in zip(exposed.tolist(), off.tolist(), strict=True)]
    search = online_capstan.after_change(TRUE)
    for _ in range(8):
        online_capstan.begin(search, t[first:], handles[first:], frames, before.states, 6.0)
        while search.window is not None:
            online_capstan.work(search)
    expected = _friction(TRUE, times)
    # the section's friction is told from the conduit's by the bends at which the loops widen
    assert search.parameters.conduit_exponent == pytest.approx(expected.conduit_exponent, rel=0.03)
    assert search.parameters.section_friction == pytest.approx(expected.section_friction, rel=0.05)
    off_rest = np.subtract(search.parameters[2:], TRUE[2:]) / online_capstan.CHANGED_WIDTH[2:]
    assert np.abs(off_rest).max() < 0.2  # of what their prior allows


def test_a_step_never_raises_the_cost() -> None:
    t = np.arange(0.0, 27.0, 0.02)
    handles = _exercise(t)
    frames = _frames(t, handles)
    search, misfits = Search(), []
    for _ in range(8):
        online_capstan.begin(search, t, handles, frames, ([], []))
        while search.window is not None:
            online_capstan.work(search)
        misfits.append(search.misfit_rad)
    assert misfits[-1] < misfits[0] / 2
    # the cost includes the prior, so the misfit alone may rise a little
    assert all(b < a * 1.05 for a, b in pairwise(misfits))


def test_the_default_instrument_lies_within_the_bounds() -> None:
    for shaft in (0.0, 6.28):
        cable = cable_of(Instrument(), shaft)
        values = (
            cable.conduit_exponent,
            cable.section_friction,
            cable.stiffness,
            cable.slack_m,
            1.0,
        )
        low, high = list(online_capstan.LOW[:CABLE]), list(online_capstan.HIGH[:CABLE])
        low[2], high[2] = exp(low[2]), exp(high[2])
        assert all(a <= v <= b for a, v, b in zip(low, values, high, strict=True))
