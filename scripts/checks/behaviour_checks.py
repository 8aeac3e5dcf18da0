"""Checks of the twin's behaviour: rate, creep, growth, symmetry, repeatability, energy."""

from __future__ import annotations

from functools import cache
from itertools import pairwise, product
from math import degrees, inf, pi, radians

import mujoco
import numpy as np

from endolock.control.rms import rms
from endolock.hw.api import Command
from endolock.scripts.checks.check import Check, check
from endolock.scripts.checks.strokes import (
    SHAFTS_DEG,
    hinges,
    loop,
    still,
    turn,
    width,
)
from endolock.twin.physics.surrogate_plant import Transmission
from endolock.twin.rig import TwinRig
from endolock.twin.surrogate import SurrogateRig
from endolock.twin.world import instrument_files
from endolock.twin.world.fitted_plays import plays_of
from endolock.twin.world.instrument import Instrument, Numerics
from endolock.twin.world.instrument_cable import transmission_of

CHECKS: list[Check] = []


@check(
    CHECKS,
    "loop width in 5 s",
    against="in 40 s",
    unit="%",
    high=3.0,
    why="dry friction is rate-independent; servo lag and damping are not",
)
def rate_dependence() -> float:
    """Compare the loop width at 30 deg in 5 s with that in 40 s [%]."""
    slow, fast = (width(loop(still(), 1.6, period), 30) for period in (40.0, 5.0))
    return abs(100 * (fast / slow - 1))


@check(
    CHECKS,
    "creep of the tip in a minute with the handles held, every instrument",
    against="none",
    unit="deg",
    high=0.5,
    why="the solver's friction rows are soft; a fiftieth of the loop",
)
def drift() -> float:
    """Hold the handles after a stroke and measure the creep of the tip in a minute [deg]."""
    worst = 0.0
    for name in instrument_files.names():
        plant = still(instrument_files.load(name))
        turn(plant, [(0.0, 0.0), (5.0, 1.0), (6.0, 1.0)])
        held = turn(plant, [(0.0, 1.0), (60.0, 1.0)])
        worst = max(worst, abs(held.bend[-1] - held.bend[0]))
    return degrees(worst)


@cache
def width_at(shaft_deg: float) -> float:
    """Return the loop width at 30 deg with the shaft bent, as a fraction of 180 deg."""
    return width(loop(still(shaft_deg=shaft_deg), 1.6, 20.0), 30)


@check(
    CHECKS,
    "loop width at 30 deg, shaft at 180 deg",
    against="w = 0.2 (calibrated)",
    unit="of 180 deg",
    low=0.18,
    high=0.22,
    why="w has one digit in the excerpt",
)
def calibrated_width() -> float:
    """Width at 30 deg of bend with the shaft bent 180 deg, of 180 deg."""
    return width_at(180.0)


@check(
    CHECKS,
    "smallest growth of the loop width, shaft from 0 to 180 to 360 deg",
    against="more bend, more friction",
    unit="%",
    low=10.0,
    why="well above the 3 % of the rate",
)
def growth_with_shaft() -> float:
    """Smallest growth of the width at 30 deg from shaft 0 to 180 to 360 deg [%]."""
    widths = [width_at(shaft_deg) for shaft_deg in SHAFTS_DEG]
    return 100 * min(b / a - 1 for a, b in pairwise(widths))


@check(
    CHECKS,
    "growth of the loop width with the other axis at 60 deg",
    against="reported by the thesis",
    unit="%",
    low=15.0,
    why="its size is assumed",
)
def growth_with_other_axis() -> float:
    """Growth of the width at 30 deg with the other axis bent by 60 deg [%]."""
    beside = still()
    angle = 0.0
    while beside.data.qpos[hinges(beside.model, 1)].sum() < radians(60):
        turn(beside, [(0.0, angle), (0.1, angle := angle + 0.02)], axis=1)
    return 100 * (width(loop(beside, 1.6, 20.0), 30) / width_at(180.0) - 1)


@check(
    CHECKS,
    "bends under mirrored handles",
    against="mirrored bends",
    unit="deg",
    high=1e-9,
    why="order of summation",
)
def mirror() -> float:
    """Compare bends under mirrored handles [deg]."""
    corners = [(0.0, 0.0), (1.0, 0.5), (2.5, -0.4), (3.0, 0.1)]
    up = turn(still(), corners)
    down = turn(still(), [(t, -angle) for t, angle in corners])
    return degrees(float(np.abs(up.bend + down.bend).max()))


@check(
    CHECKS,
    "bends with steps of 1 ms",
    against="5 ms",
    unit="deg",
    high=1.0,
    why="a hundredth of the range",
)
def timestep() -> float:
    """Compare bends with steps of 1 ms and 5 ms over a loop [deg]."""
    fine, coarse = (
        loop(still(numerics=Numerics(timestep_s=step)), 1.6, 10.0).bend for step in (0.001, 0.005)
    )
    return degrees(float(np.abs(fine - coarse).max()))


@check(
    CHECKS,
    "state components that differ 0.5 s after a restore",
    against="the original run",
    unit="",
    high=0.0,
    why="bit-identical: no hidden state",
)
def restored_state() -> float:
    """Copy a moving plant's state to another one; count the components that differ 0.5 s later."""
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    differing = 0
    for name in instrument_files.names():
        first, second = still(instrument_files.load(name)), still(instrument_files.load(name))
        turn(first, [(0.0, 0.0), (0.7, 0.6)])
        size = mujoco.mj_stateSize(first.model, kind)
        before, after, again = np.empty((3, size))
        mujoco.mj_getState(first.model, first.data, before, kind)
        second.step_count = first.step_count
        mujoco.mj_setState(second.model, second.data, before, kind)
        second.refresh()
        for plant, state in ((first, after), (second, again)):
            plant.data.ctrl[:] = [-0.3, 0.4]
            plant.advance(plant.step_count + 250)
            mujoco.mj_getState(plant.model, plant.data, state, kind)
        differing += int((after != again).sum())
    return differing


@cache
def cycle_work() -> tuple[float, float]:
    """Return the least work of steady handle cycles at a fixed shaft, absorbed and dissipated [mJ].

    Updating the springs' stiffness as the section bends adds energy to them or removes it; the work
    dissipated is the sum of this energy and of the handle's work.
    """
    absorbed, lost = inf, inf
    for name, shaft, peak in product(instrument_files.names(), SHAFTS_DEG, (0.4, 1.2)):
        plant = still(instrument_files.load(name), shaft_deg=shaft)
        loop(plant, peak, 10.0)
        model, data = plant.model, plant.data
        wires = [i for i in range(model.ntendon) if model.tendon(i).name.startswith("wire")]
        handle = int(model.joint("handle_up_down").qposadr[0])
        lever = plant.instrument.pulley_radius_m
        rows, stiffness, renewed = [], model.tendon_stiffness[wires].copy(), 0.0
        for angle in np.concatenate([np.linspace(peak, -peak, 501), np.linspace(-peak, peak, 501)]):
            data.ctrl[0] = angle
            plant.advance(plant.step_count + round(0.010 / plant.timestep_s))
            proximal, _ = plant.snapshot().tensions
            rows.append((data.qpos[handle], lever * (proximal[0] - proximal[2])))
            stretch = np.maximum(data.ten_length[wires] - model.tendon_lengthspring[wires, 1], 0.0)
            now = model.tendon_stiffness[wires]
            renewed += float(((now - stiffness) * stretch**2).sum()) / 2
            stiffness = now.copy()
        angles, moments = np.array([*rows, rows[0]]).T
        work = float(np.trapezoid(moments, angles))
        absorbed, lost = min(absorbed, 1e3 * work), min(lost, 1e3 * (work + renewed))
    return absorbed, lost


@check(
    CHECKS,
    "work absorbed by a steady handle cycle, least of 18",
    against="passivity",
    unit="mJ",
    low=0.0,
    why="dry friction dissipates",
)
def work_absorbed() -> float:
    """Return the least work absorbed by a cycle [mJ]."""
    return cycle_work()[0]


@check(
    CHECKS,
    "work dissipated by it, without that of the stiffness updates",
    against="passivity",
    unit="mJ",
    low=0.0,
    why="the same",
)
def work_dissipated() -> float:
    """Return the least work dissipated by a cycle [mJ]."""
    return cycle_work()[1]


@check(
    CHECKS,
    "bend of the surrogate over 40 s of random handle motion",
    against="the twin",
    unit="deg rms",
    high=2.0,
    why="plays model neither the other axis nor the bend; sufficient to rank controllers",
)
def surrogate() -> float:
    """Drive twin and surrogate with the same goals [deg]."""
    return apart_from_twin(plays_of(Instrument(), 180.0))


@check(
    CHECKS,
    "bend of the quasi-static rig over the same motion",
    against="the twin",
    unit="deg rms",
    high=0.5,
    why="no inertia, no gravity, a bend that lags by one step of 10 ms",
)
def quasi_static() -> float:
    """Drive twin and quasi-static rig with the same goals [deg]."""
    return apart_from_twin(transmission_of(Instrument(), pi))


def apart_from_twin(transmission: Transmission) -> float:
    """Drive the twin and a model with the same goals; return the rms bend difference [deg]."""
    pair = (TwinRig("rest", pictures=False), SurrogateRig("rest", transmission=transmission))
    random = np.random.default_rng(0)
    t = np.arange(0.0, 40.0, 0.02)
    goals = np.zeros((len(t), 2))
    for _ in range(6):
        rate, phase, size = (random.uniform(*r, 2) for r in ((0.2, 1.3), (0.0, 6.3), (0.1, 0.4)))
        goals += size * (np.sin(rate * t[:, None] + phase) - np.sin(phase))
    bends = []
    for rig in pair:
        with rig:
            rig.actuators.enable()
            bend = []
            for time, goal in zip(t.tolist(), goals.tolist(), strict=True):
                rig.clock.sleep_until(time)
                rig.actuators.exchange(Command(position=goal))
                bend.append(rig.truth.now().plant.bend_rad)
        bends.append(np.array(bend))
    return degrees(rms(bends[0] - bends[1]))
