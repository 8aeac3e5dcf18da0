"""Friction nodes in the model: initial state, and effects of shaft and sheath.

Agreement with closed forms is tested through scripts/studies/verification.py.
"""

from dataclasses import replace
from itertools import pairwise
from math import degrees, pi, radians

import numpy as np
import pytest

from endolock.scripts.checks.strokes import ONE_WIRE, loop, still, turn, width
from endolock.twin.model import scene
from endolock.twin.model.wire_springs import rest_slides, spring_stiffness
from endolock.twin.physics.plant import TwinPlant
from endolock.twin.physics.wire_friction import ROW_SOFTNESS
from endolock.twin.rig import TwinRig
from endolock.twin.world import instrument_files, scenario
from endolock.twin.world.instrument import NUMERICS, WIRES, Instrument, Numerics
from endolock.twin.world.playback import Course

INSTRUMENT = Instrument()


@pytest.mark.parametrize("nodes", [1, 2, 5])
def test_without_friction_the_cable_is_one_spring(nodes: int) -> None:
    smooth = replace(INSTRUMENT, conduit_friction=0.0, section_friction=0.0)
    springs = spring_stiffness(smooth, nodes, pi, 1.0)
    in_series = 1 / sum(1 / k for k in springs)
    # the floor of 1e-3 on a node's a leaves tanh(a/2)/(a/2) = 1 - a^2/12
    assert in_series == pytest.approx(INSTRUMENT.wire_stiffness, rel=1e-6)


@pytest.mark.parametrize("numerics", NUMERICS.values(), ids=NUMERICS)
def test_nothing_moves_at_rest(numerics: Numerics) -> None:
    rig = TwinRig("rest", numerics=numerics, pictures=False)
    rig.clock.sleep_until(1.0)
    plant = rig.truth.now().plant
    for n, slide in enumerate(rest_slides(INSTRUMENT, numerics.nodes, pi), 1):
        for wire in WIRES:
            at = rig.plant.data.joint(f"slide_{wire}_{n}").qpos[0]
            assert at == pytest.approx(slide, abs=1e-12)
    # four equal pulls cancel up to rounding of 15 N
    assert plant.bend_rad == pytest.approx((0.0, 0.0), abs=1e-9)
    tensions = [*plant.tension_handle_n, *plant.tension_section_n]
    assert tensions == pytest.approx([tensions[0]] * 8, rel=1e-9)


@pytest.mark.parametrize("gravity", [pytest.param(False, marks=pytest.mark.slow), True])
@pytest.mark.parametrize("numerics", NUMERICS.values(), ids=NUMERICS)
@pytest.mark.parametrize("name", instrument_files.names())
def test_a_minute_of_random_drive_raises_no_warning(
    name: str, numerics: Numerics, gravity: bool
) -> None:
    plant = still(instrument_files.load(name), numerics, gravity=gravity)
    random = np.random.default_rng(7)
    while plant.t < 60.0:
        plant.data.ctrl[:] = random.uniform(-1.5, 1.5, 2)
        plant.advance(plant.step_count + round(0.4 / plant.timestep_s))
    assert sum(int(w.number) for w in plant.data.warning) == 0
    assert np.isfinite(plant.data.qpos).all()


def test_the_nodes_friction_rows_are_stiffened() -> None:
    """Without it, a node under load creeps by degrees per minute."""
    built = scene.build().compile()
    rows = [int(built.joint(f"slide_{wire}_1").dofadr[0]) for wire in WIRES]
    kept = TwinRig("rest", pictures=False).plant.model
    ratio = kept.dof_invweight0[rows] / built.dof_invweight0[rows]
    assert ratio == pytest.approx([ROW_SOFTNESS] * 4)


@pytest.mark.parametrize("fraction", [0.0, 0.5, 0.9, 1.1, 2.0, 4.0])
def test_bending_the_shaft_removes_the_slack_and_then_adds_tension(fraction: float) -> None:
    """The two regions: at slack_m / slack_loss the deadband is gone and pretension begins."""
    two = instrument_files.load("two_region")
    shaft = fraction * two.slack_m / two.slack_loss_m_per_rad
    plant = still(two, shaft_deg=degrees(shaft))
    pretension = max(0.0, -two.slack_at(shaft)) * two.wire_stiffness
    # springs of a friction cable are stiffer in series than without, by cosh: 5 % at a = 0.8
    assert plant.snapshot().tensions[1] == pytest.approx([pretension] * 4, rel=0.05)
    turn(plant, [(0.0, 0.0), (2.0, -0.3)])
    loose = []
    for angle in np.linspace(-0.3, 0.3, 1201):
        plant.data.ctrl[0] = angle
        plant.advance(plant.step_count + 5)
        tension = plant.snapshot().tensions[1]
        if tension[0] == tension[2] == 0.0:
            loose.append(plant.data.joint("handle_up_down").qpos[0])
    dead = np.ptp(loose) if loose else 0.0
    right = 2 * max(0.0, two.slack_at(shaft)) / two.pulley_radius_m
    assert dead == pytest.approx(right, rel=0.1, abs=0.002)  # threshold of the tip; four rows


def test_a_shaft_bent_during_a_run_ends_as_one_bent_from_the_start() -> None:
    """Bending it with the handles at zero changes only stiffness and tension."""
    bent = scenario.load("rest", {"shaft_bend_deg": 0.0})
    change = {"kind": "bend", "start_s": 0.5, "over_s": 1.0, "by_deg": 180.0}
    bent = scenario.Scenario.model_validate({**bent.model_dump(), "shaft": [change]})
    late = TwinPlant(bent, INSTRUMENT, Numerics(), 0)
    turn(late, [(0.0, 0.0), (2.0, 0.0)])
    always = still(shaft_deg=180.0)
    strokes = [turn(p, [(0.0, 0.0), (5.0, 1.0), (10.0, -1.0)]) for p in (late, always)]
    # the nodes come to rest differently while a changes, which one stroke erases
    assert degrees(abs(strokes[0].bend[-1] - strokes[1].bend[-1])) < 0.1
    assert Course(bent, 0).shaft_bend_rad(2.0) == pytest.approx(radians(180.0))


def test_a_pushed_tip_stays_displaced_within_the_friction_of_its_sheath() -> None:
    """Slack wires do not hold the tip, the sheath does, up to its moment over the stiffness."""
    rubbing = replace(ONE_WIRE, slack_m=0.002, sheath_friction_nm=0.004)
    smooth = replace(rubbing, sheath_friction_nm=0.0)
    ends = {}
    for name, instrument in (("rubbing", rubbing), ("smooth", smooth)):
        plant = still(instrument)
        tip = plant.model.body("tip").id
        # 0.5 N at the tip, 45 mm from the hinges on average: 0.37 rad, and back
        for force in (*np.linspace(0, 0.5, 100), *np.linspace(0.5, 0, 400), *np.zeros(100)):
            plant.data.xfrc_applied[tip, 2] = force
            plant.advance(plant.step_count + 5)
        ends[name] = plant.explain(plant.snapshot())[0].bend_rad[0]
    assert abs(ends["smooth"]) < 1e-4
    # released slowly, it returns until the sheath holds K theta
    held = rubbing.sheath_friction_nm / rubbing.bending_stiffness
    assert ends["rubbing"] == pytest.approx(held, rel=0.02)


def test_the_width_grows_in_both_regions() -> None:
    """Slack: at a bend, where one wire is loaded. Pretension: also at zero bend, where it was zero.

    In between, at 40 to 60 deg of shaft, the second wire begins to carry at that bend too: the
    pair is stiffer, loses less motion, and the width there dips once.
    """
    two = instrument_files.load("two_region")
    loops = {
        s: loop(still(two, shaft_deg=s), 1.6, 20.0) for s in (0, 10, 20, 30, 60, 120, 180, 270)
    }
    slack = [width(loops[s], 25) for s in (0, 10, 20)]
    tight = [width(loops[s], 25) for s in (60, 120, 180, 270)]
    middle = [width(loops[s], 0) for s in (30, 60, 120, 180, 270)]
    for widths in (slack, tight, middle):
        assert all(a < b for a, b in pairwise(widths)), widths
