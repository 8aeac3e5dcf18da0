"""Transmissions of other kinds: their loops in closed form, and what all of them share."""

from __future__ import annotations

import json
from itertools import pairwise
from math import exp, pi, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.control import loop, registry
from endolock.control.transmission.plays import Plays
from endolock.hw.api import Vector
from endolock.scripts.runs import rigs
from endolock.twin.physics.foreign_plants import (
    BoucWen,
    CreepAndDrift,
    DeadZone,
    PlayBehindDeadZone,
)
from endolock.twin.physics.surrogate_plant import TIMESTEP_S, Transmission, bend_of
from endolock.twin.physics.unequal_wires import UnequalWires
from endolock.twin.world import scenario
from endolock.twin.world.instrument import Instrument

TIMELESS = {name: made for name, (made, _) in rigs.FIXED.items() if name != "creep_and_drift"}
PATHS = st.lists(st.floats(-2.5, 2.5), min_size=2, max_size=6)


def path(corners: list[float], step: float) -> Vector:
    """Return handle angles from zero through corners, in steps of at most `step` [rad]."""
    parts = [np.zeros(1)]
    for a, b in pairwise([0.0, *corners]):
        parts.append(np.linspace(a, b, 2 + int(abs(b - a) / step))[1:])
    return np.concatenate(parts)


def width_at(transmission: Transmission, bend_rad: float, stroke_rad: float = 2.5) -> float:
    """Return the difference of the handle angles at a bend, on the way up and down [rad]."""
    handle = path([stroke_rad, -stroke_rad, stroke_rad, -stroke_rad], 0.001)
    bend = bend_of(transmission, handle)
    peak = np.flatnonzero(handle == stroke_rad)[-1]
    trough = np.flatnonzero(handle == -stroke_rad)[0]
    up, down = slice(trough, peak + 1), slice(peak, None)
    rising = np.interp(bend_rad, bend[up], handle[up])
    return float(rising - np.interp(-bend_rad, -bend[down], handle[down]))


@pytest.mark.parametrize(
    ("transmission", "width_rad"),
    [
        (DeadZone(half_width_rad=0.2), 0.0),
        (PlayBehindDeadZone(slack_rad=0.1, half_width_rad=0.15), 2 * 0.15),
        (BoucWen(half_width_rad=0.25), 2 * 0.25),  # a long stroke lacks e^-7 of it
    ],
)
def test_width_of_a_loop(transmission: Transmission, width_rad: float) -> None:
    """Beside the gap of a dead zone, where many handle angles have the same bend."""
    assert width_at(transmission, 0.5) == pytest.approx(width_rad, abs=1e-3)


@pytest.mark.parametrize("bend_rad", [-0.8, 0.0, 0.8])
def test_the_loop_of_unequal_wires_widens_to_one_side(bend_rad: float) -> None:
    pair = UnequalWires(positive_rad=(0.4,), negative_rad=(0.2,), weights=(1.0,))
    ratios = 1 / pair.positive_slope - 1 / pair.negative_slope
    assert width_at(pair, bend_rad) == pytest.approx(0.6 + bend_rad * ratios, abs=1e-3)


def test_a_dead_zone_does_nothing_within_it_and_has_no_history() -> None:
    made = DeadZone(half_width_rad=0.2, bend_per_handle=0.9)
    handle = path([1.0, -0.2, 0.2, -1.0], 0.01)
    expected = 0.9 * np.sign(handle) * np.maximum(np.abs(handle) - 0.2, 0.0)
    assert bend_of(made, handle) == pytest.approx(expected, abs=1e-12)


def test_a_stroke_from_rest_loses_what_bouc_and_wen_say() -> None:
    made = BoucWen(half_width_rad=0.3, lost_share=0.8, bend_per_handle=1.0)
    lost = 0.3 * (1 - exp(-0.8 * 0.5 / 0.3))
    up, back = bend_of(made, np.array([0.5, 0.4]))
    assert up == pytest.approx(0.5 - lost, abs=1e-12)
    assert back == pytest.approx(up - (1 - 0.8) * 0.1, abs=1e-12)  # elastic after the reversal


def test_unequal_wires_are_off_centre() -> None:
    made = UnequalWires(positive_rad=(0.5,), negative_rad=(0.1,), weights=(1.0,))
    bend = bend_of(made, np.array([0.5, 0.6, 0.0, -0.1, -0.2]))
    assert bend[:2] == pytest.approx((0.0, 0.1 * made.positive_slope))
    assert bend[3:] == pytest.approx((0.0, -0.1 * made.negative_slope))


def test_a_held_bend_creeps_and_the_zero_drifts() -> None:
    made = CreepAndDrift()
    after = 3000
    bend = bend_of(made, np.full(after, 1.0))
    t = after * TIMESTEP_S
    held = made.bend_per_handle * (1.0 - made.half_width_rad)
    crept = held * made.creep_share * (1 - exp(-t / made.creep_time_s))
    drift = made.drift_rad * sin(2 * pi * t / made.drift_period_s)
    assert bend[-1] == pytest.approx(held - crept + drift, abs=1e-9)
    assert min(crept, drift) > 0.01  # both are there to be seen


@pytest.mark.parametrize("name", TIMELESS)
@settings(max_examples=30)
@given(corners=PATHS, step=st.floats(0.02, 0.5))
def test_the_bend_depends_on_the_path_alone(name: str, corners: list[float], step: float) -> None:
    """Rate independence: however finely a path is divided, its end is the same."""
    ends = [bend_of(TIMELESS[name], path(corners, s))[-1] for s in (step, 0.011)]
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)


@pytest.mark.parametrize("name", TIMELESS)
@settings(max_examples=30)
@given(corners=PATHS)
def test_the_bend_never_turns_against_its_handle(name: str, corners: list[float]) -> None:
    handle = path(corners, 0.05)
    moved = np.diff(handle) * np.diff(bend_of(TIMELESS[name], handle))
    assert moved.min() >= -1e-12


@pytest.mark.parametrize("name", rigs.FIXED)
def test_axes_are_independent_and_a_second_start_is_fresh(name: str) -> None:
    made = rigs.FIXED[name][0]
    first, other = made.at_rest(), made.at_rest()
    first.follow((1.0, -1.0))
    alone = [first.follow((0.5, -0.5))[1], other.follow((0.5, 0.0))[0]]
    again = made.at_rest()
    again.follow((-0.3, -1.0))
    assert again.follow((0.2, -0.5))[1] == alone[0]
    assert made.at_rest().follow((0.5, 0.9))[0] == alone[1]


@pytest.mark.parametrize("name", rigs.FIXED)
def test_a_law_runs_on_each_and_the_rig_describes_itself(name: str) -> None:
    short = scenario.load("circle", {"duration_s": 5.0})
    rig, eyes = rigs.make(name, short, vision="truth", instrument=Instrument(), seed=0)
    with rig:
        law = registry.make("pi", rig.camera.calibration)
        ran = loop.run(rig, eyes, law, duration_s=5.0)
        assert json.loads(json.dumps(rig.describe()))["transmission"]
    bends = np.array([tick.truth.plant.bend_rad for tick in ran.ticks if tick.truth])
    assert np.ptp(bends, axis=0).min() > 0.05  # both axes have moved


def test_the_nearest_plays_are_the_plant_s_own_or_come_near() -> None:
    handle = path([1.2, -1.2, 1.2], 0.02)
    for name, (made, _) in rigs.FIXED.items():
        near = rigs.plays_behind(name, Instrument(), 180.0)
        off = bend_of(near, handle) - bend_of(made, handle)
        if isinstance(made, Plays):
            assert near == made
        # the worst is the dead zone, which no sum of plays can be: half its gap, and some
        assert np.abs(off).max() < 0.25
