"""The friction nodes against the closed forms of an elastic cable with Coulomb friction."""

from dataclasses import replace
from math import degrees, exp, expm1, pi

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.hw.api import Command
from endolock.twin import scenario, scene
from endolock.twin.instrument import Instrument
from endolock.twin.plant import TwinPlant
from endolock.twin.rig import TwinRig
from endolock.twin.transmission import (
    ROW_SOFTNESS,
    WIRES,
    friction_ratio,
    rest_slide,
    spring_stiffness,
)

INSTRUMENT = Instrument()


@given(wrap_rad=st.floats(0.1, 12.0), bend_rad=st.floats(0.0, 3.0))
def test_one_node_has_the_slip_slopes_of_the_whole_cable(wrap_rad: float, bend_rad: float) -> None:
    """While it slips T_in = T_out e^(+-S), so the travel is T_out (c1 e^(+-S) + c2) = T_out A/k."""
    a = INSTRUMENT.conduit_friction * wrap_rad
    b = INSTRUMENT.section_friction * bend_rad
    proximal, distal = spring_stiffness(INSTRUMENT, wrap_rad, bend_rad)
    k = INSTRUMENT.wire_stiffness
    pull = exp(b) * expm1(a) / a
    release = exp(-b) * -expm1(-a) / a
    # a = 0.016 at the least: cosh a - 1 keeps 12 of its 16 digits there
    assert exp(a + b) / proximal + 1 / distal == pytest.approx(pull / k, rel=1e-9)
    assert exp(-a - b) / proximal + 1 / distal == pytest.approx(release / k, rel=1e-9)


@given(wrap_rad=st.floats(0.0, 12.0), bend_rad=st.floats(0.0, 3.0))
def test_the_friction_bound_is_the_capstan_ratio(wrap_rad: float, bend_rad: float) -> None:
    ratio = friction_ratio(INSTRUMENT, wrap_rad, bend_rad)
    s = INSTRUMENT.conduit_friction * wrap_rad + INSTRUMENT.section_friction * bend_rad
    assert (1 + ratio) / (1 - ratio) == pytest.approx(exp(s), rel=1e-9)  # s < 2.6, no cancellation


def test_without_curvature_the_cable_is_one_spring() -> None:
    proximal, distal = spring_stiffness(INSTRUMENT, 1e-6, 0.0)
    in_series = 1 / (1 / proximal + 1 / distal)
    # the floor of 1e-3 on a leaves b = 0 and A = 1 + a/2
    assert in_series == pytest.approx(INSTRUMENT.wire_stiffness, rel=1e-3)


def test_rest_is_rest() -> None:
    rig = TwinRig("rest", pictures=False)
    rig.clock.sleep_until(1.0)
    plant = rig.truth.now().plant
    slide = rest_slide(INSTRUMENT, pi)
    for wire in ("up", "right", "down", "left"):
        assert rig.plant.data.joint(f"slide_{wire}").qpos[0] == pytest.approx(slide, abs=1e-12)
    # four equal pulls cancel up to rounding of 15 N
    assert plant.bend_rad == pytest.approx((0.0, 0.0), abs=1e-9)
    tensions = [*plant.tension_handle_n, *plant.tension_section_n]
    assert tensions == pytest.approx([tensions[0]] * 8, rel=1e-9)


def test_a_pulled_wire_loses_tension_as_a_capstan() -> None:
    rig = TwinRig("rest", pictures=False)
    with rig:
        rig.actuators.enable()
        for n in range(200):
            rig.actuators.exchange(Command(position=(0.004 * n, 0.0)))
            rig.clock.sleep_until(0.02 * (n + 1))
        plant = rig.truth.now().plant
    s = INSTRUMENT.conduit_friction * (INSTRUMENT.residual_wrap_rad + pi)
    s += INSTRUMENT.section_friction * abs(plant.bend_rad[0])
    ratio = plant.tension_handle_n[0] / plant.tension_section_n[0]
    assert ratio == pytest.approx(exp(s), rel=0.01)  # 1 %: the node is damped and moves


def test_mirrored_commands_give_mirrored_bends() -> None:
    def bends(sign: float) -> np.ndarray:
        rig = TwinRig("rest", pictures=False)
        with rig:
            rig.actuators.enable()
            out = []
            for n in range(100):
                goal = 0.5 * np.sin(0.08 * n)
                # quantising is symmetrical: Python rounds halves to even on both sides
                rig.actuators.exchange(Command(position=(sign * goal, sign * 0.5 * goal)))
                rig.clock.sleep_until(0.02 * (n + 1))
                out.append(rig.truth.now().plant.bend_rad)
        return np.array(out)

    worst = np.abs(bends(1.0) + bends(-1.0)).max()
    assert degrees(worst) < 1e-9  # rounding: sums run in another order on the other side


def test_snapshot_and_restore_are_bit_identical() -> None:
    plant = _moving_plant()
    spec = mujoco.mjtState.mjSTATE_INTEGRATION
    size = mujoco.mj_stateSize(plant.model, spec)
    before, first, second = np.empty((3, size))
    mujoco.mj_getState(plant.model, plant.data, before, spec)
    plant.advance(plant.step_count + 250)
    mujoco.mj_getState(plant.model, plant.data, first, spec)

    other = _plant()
    mujoco.mj_setState(other.model, other.data, before, spec)
    other.step_count = plant.step_count - 250
    other.advance(other.step_count)
    other._transmission.refresh(other.data, other.shaft_bend_rad)
    other.advance(plant.step_count)
    mujoco.mj_getState(other.model, other.data, second, spec)
    assert np.array_equal(first, second)


def test_random_drive_raises_no_warning() -> None:
    plant = _plant()
    _drive_at_random(plant, seconds=2.0)


@pytest.mark.slow
def test_a_minute_of_random_drive_raises_no_warning() -> None:
    plant = _plant()
    _drive_at_random(plant, seconds=60.0)


@pytest.mark.slow
def test_a_held_handle_holds_the_tip() -> None:
    rig = TwinRig("rest", pictures=False)
    with rig:
        rig.actuators.enable()
        for n in range(250):
            rig.actuators.exchange(Command(position=(0.002 * n, 0.0)))
            rig.clock.sleep_until(0.02 * (n + 1))
        rig.actuators.hold()
        rig.clock.sleep_until(6.0)
        before = rig.truth.now().plant.bend_rad[0]
        rig.clock.sleep_until(66.0)
        drift = degrees(rig.truth.now().plant.bend_rad[0] - before)
    assert abs(drift) < 0.5  # creep of the solver's soft friction rows, per minute


def test_slack_wires_leave_a_dead_handle() -> None:
    """Up to slack / r_p = 0.1 rad the handle only takes up slack; beyond it the tip follows."""
    slack = replace(INSTRUMENT, slack_m=0.0005)
    handle, bend = _slow_stroke(TwinRig("rest", instrument=slack, pictures=False), 0.15)
    dead, live = handle < 0.095, handle > 0.11
    assert handle.max() > 0.14
    assert np.abs(bend[dead]).max() < 1e-4  # friction of 1e-6 N drags a little
    assert bend[live].min() > 1e-3


def test_the_loop_has_the_width_it_was_calibrated_to() -> None:
    """With the shaft bent 180 deg and the tip 30 deg, w = 0.2 of 180 deg (thesis ch. 6)."""
    rig = TwinRig("rest", pictures=False)
    with rig:
        rig.actuators.enable()
        loop = []
        for n in range(1125):  # a quarter of a 10 s triangle, then two whole ones
            phase = (0.02 * n / 10 + 0.25) % 1
            goal = 1.6 * (1 - abs(4 * phase - 2))
            state = rig.actuators.exchange(Command(position=(goal, 0.0)))
            rig.clock.sleep_until(0.02 * (n + 1))
            loop.append((state.position[0], rig.truth.now().plant.bend_rad[0]))
    handle, bend = np.array(loop[625:]).T  # from one crest to the next
    falling, rising = slice(0, 250), slice(250, 500)
    at_30_deg = pi / 6
    going_back = np.interp(-at_30_deg, -bend[falling], handle[falling])
    coming_up = np.interp(at_30_deg, bend[rising], handle[rising])
    # 10 %: w has one digit in the excerpt
    assert (coming_up - going_back) / pi == pytest.approx(0.20, abs=0.02)


def test_the_nodes_friction_rows_are_stiffened() -> None:
    """Without it a node under load creeps by degrees a minute."""
    built = scene.build().compile()
    rows = [int(built.joint(f"slide_{wire}").dofadr[0]) for wire in WIRES]
    kept = TwinRig("rest", pictures=False).plant.model
    ratio = kept.dof_invweight0[rows] / built.dof_invweight0[rows]
    assert ratio == pytest.approx([ROW_SOFTNESS] * 4)


def _slow_stroke(rig: TwinRig, end_rad: float) -> tuple[np.ndarray, np.ndarray]:
    """Turn up_down from 0 to an angle in 4 s; return handle angles and bends [rad]."""
    rows = []
    with rig:
        rig.actuators.enable()
        for n in range(200):
            state = rig.actuators.exchange(Command(position=(end_rad * n / 199, 0.0)))
            rows.append((state.position[0], rig.truth.now().plant.bend_rad[0]))
            rig.clock.sleep_until(0.02 * (n + 1))
    handle, bend = np.array(rows).T
    return handle, bend


def _plant() -> TwinPlant:
    rig = TwinRig(scenario.load("rest"), pictures=False)
    rig.actuators.connect()
    rig.actuators.enable()
    return rig.plant


def _moving_plant() -> TwinPlant:
    plant = _plant()
    plant.data.ctrl[:] = [0.4, -0.3]
    plant.advance(200)
    return plant


def _drive_at_random(plant: TwinPlant, seconds: float) -> None:
    random = np.random.default_rng(7)
    while plant.t < seconds:
        plant.data.ctrl[:] = random.uniform(-1.5, 1.5, 2)
        plant.advance(plant.step_count + 100)
    assert sum(int(w.number) for w in plant.data.warning) == 0
    assert np.isfinite(plant.data.qpos).all()
