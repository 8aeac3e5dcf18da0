"""Checks of the transmission and the section against closed forms and independent solvers."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product
from math import degrees, exp, pi, radians

import mujoco
import numpy as np

from endolock.control.transmission.quasi_static import Geometry
from endolock.control.transmission.simulation import simulate
from endolock.hw.api import AXES
from endolock.scripts.checks.check import Check, check
from endolock.scripts.checks.strokes import (
    ONE_WIRE,
    SEED,
    SHAFTS_DEG,
    HandleMotion,
    hinges,
    still,
    turn,
)
from endolock.twin.physics import closed_forms
from endolock.twin.physics.closed_forms import PulledSection
from endolock.twin.world import instrument_files
from endolock.twin.world.instrument import NUMERICS, WIRES, Instrument, Numerics
from endolock.twin.world.instrument_cable import cable_of

CHECKS: list[Check] = []


@check(
    CHECKS,
    "wire lengths at random hinge angles",
    against="closed form",
    unit="m",
    high=1e-12,
    why="rounding of 0.1 m",
)
def wire_lengths() -> float:
    """Compare the lengths of the wires at random hinge angles with the closed form [m]."""
    plant = still()
    model, data = plant.model, plant.data
    random = np.random.default_rng(SEED)
    instrument, count = plant.instrument, Numerics().hinges
    h, r = instrument.bending_length_m / count, instrument.wire_radius_m
    straight = model.tendon("wire_up").id
    worst = 0.0
    for _ in range(20):
        angles = random.uniform(-0.4, 0.4, (2, count // 2))
        for axis in (0, 1):
            data.qpos[hinges(model, axis)] = angles[axis]
        mujoco.mj_fwdPosition(model, data)
        for n, wire in enumerate(WIRES):
            own, sign = n % 2, 1 if n < 2 else -1
            inside = h * np.cos(angles / 2)
            inside[own] -= sign * 2 * r * np.sin(angles[own] / 2)
            slide = data.qpos[model.joint(f"slide_{wire}_1").qposadr[0]]
            outside = 0.02 + slide  # node to base
            length = data.ten_length[straight + n]
            worst = max(worst, abs(length - inside.sum() - outside))
    return worst


@check(
    CHECKS,
    "hinge angles at rest without friction, hanging",
    against="balance of moments, scipy",
    unit="deg",
    high=1e-4,
    why="residual motion after 5 s",
)
def static_section() -> float:
    """Compare hinge angles without friction, with gravity, with the balance of moments [deg]."""
    smooth = Instrument(conduit_friction=0.0, section_friction=0.0)
    worst = 0.0
    for numerics, handles in product(NUMERICS.values(), ((0.8, -0.5), (0.0, 1.2))):
        plant = still(smooth, numerics, gravity=True)
        turn(plant, [(0.0, 0.0), (1.0, handles[0])])
        turn(plant, [(0.0, 0.0), (1.0, handles[1]), (6.0, handles[1])], axis=1)
        data, model = plant.data, plant.model
        at = [data.qpos[model.joint(f"handle_{axis}").qposadr[0]] for axis in AXES]
        found = np.empty(numerics.hinges)
        for axis in (0, 1):
            found[axis::2] = data.qpos[hinges(model, axis)]
        right = closed_forms.static_hinges(
            smooth, numerics.hinges, (float(at[0]), float(at[1])), gravity=True
        )
        worst = max(worst, float(np.abs(found - right).max()))
    return degrees(worst)


@check(
    CHECKS,
    "tension ratio of a sliding wire, a = 0.2, 0.5, 1",
    against="capstan, e^(+-a)",
    unit="%",
    high=1.0,
    why="the nodes are damped and move",
)
def capstan_ratio() -> float:
    """Compare the tension ratio of a wire that is pulled, then released, with e^(+-a) [%]."""
    worst = 0.0
    for a in (0.2, 0.5, 1.0):
        one = replace(ONE_WIRE, conduit_friction=a / ONE_WIRE.wrap_at(pi), section_friction=0.0)
        motion = turn(still(one), [(0.0, 0.0), (10.0, 1.0), (20.0, 0.0)])
        for part, s in ((motion.between(5, 10), a), (motion.between(17, 18), -a)):
            ratio = part.proximal / part.distal / exp(s)
            worst = max(worst, float(np.abs(ratio - 1).max()))
    return 100 * worst


@check(
    CHECKS,
    "travel per tension while the whole wire slides",
    against="elastic cable, A/k and B/k",
    unit="%",
    high=0.1,
    why="viscous damping: half as much at half the speed",
)
def slip_slopes() -> float:
    """Compare the travel per tension while all of the wire slides with A/k and B/k [%]."""
    worst = 0.0
    for shaft in SHAFTS_DEG:
        one = replace(ONE_WIRE, section_friction=0.0)
        motion = turn(still(one, shaft_deg=shaft), [(0.0, 0.0), (40.0, 1.2), (80.0, 0.0)])
        section = PulledSection(one, Numerics().hinges, radians(shaft))
        for part, pulling in ((motion.between(20, 40), True), (motion.between(68, 72), False)):
            right = section.stretch(part.distal, part.bend, pulling=pulling)
            got = one.pulley_radius_m * part.handle - section.pull(part.bend)
            worst = max(worst, float(np.abs(got / right - 1).max()))
    return 100 * worst


@check(
    CHECKS,
    "tension at the section in random minor loops",
    against="elastic cable, clip(T, k d/A, k d/B)",
    unit="% of peak",
    high=0.5,
    why="accuracy required of the project",
)
def random_loops() -> float:
    """Compare the tension at the section in random minor loops with the capstan cable's [%]."""
    random, worst = np.random.default_rng(SEED), 0.0
    for shaft in SHAFTS_DEG:
        corners = [(0.0, 0.0), (8.0, 1.2)]
        for angle in random.uniform(0.1, 1.4, 12):
            corners.append((corners[-1][0] + 10 * abs(angle - corners[-1][1]) + 0.5, float(angle)))
        motion = turn(still(ONE_WIRE, shaft_deg=shaft), corners)
        section = PulledSection(ONE_WIRE, Numerics().hinges, radians(shaft))
        right = section.distal_tensions(motion.handle, motion.bend)
        worst = max(worst, float(np.abs(motion.distal - right).max() / right.max()))
    return 100 * worst


@cache
def load_and_unload() -> list[tuple[HandleMotion, HandleMotion, PulledSection]]:
    """Record a slow stroke with slack wires, out and back, for three bends of the shaft."""
    slack, strokes = replace(ONE_WIRE, slack_m=0.0005), []
    for shaft in SHAFTS_DEG:
        motion = turn(still(slack, shaft_deg=shaft), [(0.0, 0.0), (60.0, 1.5), (120.0, 0.0)])
        section = PulledSection(slack, Numerics().hinges, radians(shaft))
        strokes.append((motion.between(0, 60), motion.between(60, 120), section))
    return strokes


@check(
    CHECKS,
    "handle angle at a bend, out and back, shaft at 0, 180, 360 deg",
    against="closed form",
    unit="%",
    high=0.5,
    why="accuracy required of the project",
)
def handle_angles() -> float:
    """Compare handle angles on the way out and back with the closed form [%]."""
    worst = 0.0
    for out, back, section in load_and_unload():
        for part, pulling in ((out, True), (back, False)):
            bends = np.linspace(0.2, 0.8, 13) * out.bend.max()
            bends = bends[bends < 0.9 * part.bend.max()]
            order = np.argsort(part.bend)
            got = np.interp(bends, part.bend[order], part.handle[order])
            worst = max(
                worst, float(np.abs(got / section.handle(bends, pulling=pulling) - 1).max())
            )
    return 100 * worst


@check(
    CHECKS,
    "handle motion lost between out and back, same strokes",
    against="closed form",
    unit="%",
    high=1.0,
    why="a difference of the angles above, 30 times smaller",
)
def loop_widths() -> float:
    """Compare the handle's lost motion at a bend, out against back, with the closed form [%]."""
    worst = 0.0
    for out, back, section in load_and_unload():
        bends = np.linspace(0.2, 0.8, 13) * out.bend.max()
        got = np.interp(bends, out.bend, out.handle)
        got -= np.interp(bends, back.bend[::-1], back.handle[::-1])
        right = section.handle(bends, pulling=True) - section.handle(bends, pulling=False)
        worst = max(worst, float(np.abs(got / right - 1).max()))
    return 100 * worst


@check(
    CHECKS,
    "bends in slow loops of both signs and several sizes, every instrument",
    against="quasi-static solution, control/transmission/quasi_static.py",
    unit="deg",
    high=0.1,
    why="damping at 0.1 rad/s",
)
def slow_loops() -> float:
    """Compare the bends of complete instruments with those of a quasi-static solver [deg]."""
    worst = 0.0
    for name, shaft in product(instrument_files.names(), SHAFTS_DEG[:2]):
        made = instrument_files.load(name)
        plant = still(made, shaft_deg=shaft)
        motion = turn(plant, [(0, 0), (20, 2.0), (60, -2.0), (100, 2.0), (112, 0.8), (120, 1.6)])
        handle, bend = motion.handle[::5], motion.bend[::5]
        cable, nothing = cable_of(made, radians(shaft)), np.zeros(len(handle))
        right, _ = simulate(cable, Geometry(), handle, nothing, nothing)
        worst = max(worst, float(np.abs(bend - right).max()))
    return degrees(worst)


@check(
    CHECKS,
    "handle tension after a reversal, 3 nodes per wire",
    against="elastic cable sliding by thirds",
    unit="% of peak",
    high=0.5,
    why="the sliding front of a real cable moves smoothly, up to 10 % off these straight lines",
)
def handle_tension() -> float:
    """Compare the handle tension after a reversal, three nodes per wire, with a cable's [%]."""
    one = replace(ONE_WIRE, section_friction=0.0)
    motion = turn(still(one, NUMERICS["fidelity"]), [(0.0, 0.0), (20.0, 1.2), (24.0, 0.96)])
    crest = int(motion.proximal.argmax())
    back = motion.between(motion.t[crest], 24)
    assert np.ptp(back.bend) < 0.01 * back.bend[0]  # the tip has not followed yet
    given_n = one.wire_stiffness * one.pulley_radius_m * (back.handle[0] - back.handle)
    exponent = one.conduit_exponent_at(pi)
    travel_n, tension = closed_forms.reversal(
        exponent, back.proximal[0], NUMERICS["fidelity"].nodes
    )
    right = np.interp(given_n, travel_n, tension)
    return 100 * float(np.abs(back.proximal - right).max() / back.proximal[0])


@check(
    CHECKS,
    "deadband of slack wires",
    against="2 slack / r_p",
    unit="%",
    high=10.0,
    why="depends on the threshold for motion of the tip",
)
def deadband() -> float:
    """Compare the handle angle over which slack wires leave the tip alone with 2 slack/r_p [%]."""
    slack = replace(ONE_WIRE, slack_m=0.0005)
    motion = turn(still(slack), [(0.0, 0.0), (2.0, -0.15), (10.0, 0.15)])
    still_there = motion.between(2, 10).handle[np.abs(motion.between(2, 10).bend) < 1e-3]
    right = 2 * slack.slack_m / slack.pulley_radius_m
    return abs(100 * (np.ptp(still_there) / right - 1))
