"""The capstan model inside the lock: its inverse, its search, and when it is used."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import exp

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.control import loop, registry
from endolock.control.predictive import online_capstan
from endolock.control.predictive.axis_plays import PRIOR, RADII
from endolock.control.predictive.capstan_rollout import CapstanParameters, CapstanRollout
from endolock.control.predictive.internal_model import InternalModel, at_rest
from endolock.control.predictive.online_capstan import CABLE, START, Search
from endolock.control.predictive.predictive_lock import Predictive
from endolock.control.transmission.quasi_static import Axis, Cable, Geometry
from endolock.hw.api import Mode, State, Vector
from endolock.scripts.runs.experiment import Experiment
from endolock.twin.rig import TwinRig
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.instrument_cable import cable_of
from endolock.vision.truth_eyes import TruthEyes

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


def _searched(steps: int = 14) -> tuple[Search, int]:
    t = np.arange(0.0, 27.0, 0.02)
    handles = _exercise(t)
    frames = _frames(t, handles)
    search, slices = Search(), 0
    for _ in range(steps):
        online_capstan.begin(search, t, handles, frames, ([], []))
        while search.window is not None:
            online_capstan.work(search)
            slices += 1
    return search, slices


def test_the_search_identifies_the_plant_from_the_frames() -> None:
    search, _ = _searched()
    assert search.misfit_rad < 0.003  # the splines' residual of the target
    # shapes are determined, the slope hardly: stiffness and slack compensate for each other
    assert search.parameters.conduit_exponent == pytest.approx(TRUE.conduit_exponent, abs=0.1)
    assert search.parameters[CABLE:] == pytest.approx(TRUE[CABLE:], abs=0.01)


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


def _state(t: float, handles: tuple[float, float]) -> State:
    return State(
        t=t,
        t_err=0.0,
        seq=0,
        position=handles,
        velocity=(0.0, 0.0),
        current=(0.0, 0.0),
        goal=handles,
        clipped=(0, 0),
        fresh=True,
        mode=Mode.ENABLED,
        device_tick=0,
    )


def test_without_a_capstan_the_plays_are_used() -> None:
    model = at_rest((0.1, -0.2))
    for n, turn in enumerate(np.linspace(0, 1.0, 50).tolist()):
        model.follow(_state(0.02 * n, (0.1 + turn, -0.2 - turn)))
    assert not model.capstan_used
    # no hysteresis at first: the bend is the handle's angle times the slope
    assert model.bend == pytest.approx((PRIOR[0] * 1.1, -PRIOR[0] * 1.2))
    assert model.bend_at(0.5) == pytest.approx(model.bends_at(np.array([0.5]))[0].tolist())
    assert len(model.axes[0].outputs) == len(RADII)


@pytest.mark.parametrize(("misfit", "used"), [(0.5, True), (1.1, True), (1.3, False)])
def test_the_capstan_is_used_while_its_residual_is_no_larger(misfit: float, used: bool) -> None:
    model = InternalModel(misfit_rad=0.004)
    t = np.arange(0.0, 20.0, 0.02)
    model.times, model.bends = t.tolist(), [(0.0, 0.0)] * len(t)
    model.search.steps, model.search.misfit_rad = 5, 0.004 * misfit
    model._choose()
    assert model.capstan_used is used


def test_a_capstan_with_a_small_residual_is_kept() -> None:
    model = InternalModel(misfit_rad=1e-3, capstan_used=True)
    t = np.arange(0.0, 20.0, 0.02)
    model.times, model.bends = t.tolist(), [(0.0, 0.0)] * len(t)
    model.search.steps, model.search.misfit_rad = 5, 0.006
    model._choose()
    assert model.capstan_used
    model.search.misfit_rad = 0.02
    model._choose()
    assert not model.capstan_used


def test_the_lock_adopts_the_capstan_on_the_twin_and_its_bend_is_right() -> None:
    rig = TwinRig("straight", pictures=False)
    with rig:
        rig.clock.sleep_until(0.0)
        law = registry.make("predictive_bank", rig.camera.calibration)
        assert isinstance(law, Predictive)
        run = loop.run(rig, TruthEyes(rig.truth), law, duration_s=45.0)
    assert run.ticks[-1].signals["capstan"] == 1.0
    later = [tick for tick in run.ticks if tick.t > 40.0]
    true = np.array([tick.truth.plant.bend_rad[1] for tick in later if tick.truth])
    modelled = np.array([tick.signals["bend_left_right_rad"] for tick in later])
    # one mode of handle motion does not determine the slope: only the shape counts
    slope = np.polyfit(modelled, true, 1)
    assert np.std(true - np.polyval(slope, modelled)) < 0.1 * np.std(true)


def test_a_plant_without_hysteresis_needs_no_capstan() -> None:
    request = Experiment(scenario="straight", vary=("no_hysteresis",), controller=LAW)
    task = replace(request, vision="truth").resolve()
    rig = TwinRig(task.scenario, instrument=task.instrument, pictures=False)
    with rig:
        rig.clock.sleep_until(0.0)
        law = registry.make(LAW, rig.camera.calibration, task.settings)
        run = loop.run(rig, TruthEyes(rig.truth), law, duration_s=25.0)
    widths = [tick.signals["width_left_right_rad"] for tick in run.ticks[-100:]]
    assert max(widths) < 0.05


def test_the_default_instrument_lies_within_the_bounds() -> None:
    for shaft in (0.0, 6.28):
        cable = cable_of(Instrument(), shaft)
        values = (cable.conduit_exponent, cable.section_friction, cable.stiffness, cable.slack_m)
        low, high = list(online_capstan.LOW[:CABLE]), list(online_capstan.HIGH[:CABLE])
        low[2], high[2] = exp(low[2]), exp(high[2])
        assert all(a <= v <= b for a, v, b in zip(low, values, high, strict=True))


LAW = "predictive_bank"
