"""Effects of shaft, weight, pushes and camera misalignment on tip and picture."""

from math import cos, pi, radians, sin

import numpy as np
import pytest

from endolock.hw.api import Plant
from endolock.twin.physics.plant import TwinPlant
from endolock.twin.rig import TwinRig
from endolock.twin.world.instrument import Instrument, Numerics
from endolock.twin.world.scenario import Scenario
from endolock.twin.world.scenario_sections import Push, Shaft

ROLL = Shaft(kind="roll", start_s=0.0, over_s=0.1, by_deg=10.0)


def _state(plant: TwinPlant) -> Plant:
    return plant.explain(plant.snapshot())[0]


def _bent(scenario: Scenario, **instrument: float) -> TwinPlant:
    plant = TwinPlant(scenario, Instrument(**instrument), Numerics(), 0)
    plant.data.ctrl[:] = [0.5, 0.3]
    plant.advance(1000)
    return plant


def test_rolling_the_shaft_turns_tip_and_camera_and_bends_nothing() -> None:
    plant = TwinPlant(Scenario(name="roll", shaft=(ROLL,)), Instrument(), Numerics(), 0)
    plant.advance(100)
    turned = _state(plant)
    assert turned.bend_rad == pytest.approx((0.0, 0.0), abs=1e-9)  # as at rest
    assert turned.tip.position == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    about_z = (0.0, 0.0, radians(10.0))
    assert turned.tip.rotation_vector == pytest.approx(about_z, abs=1e-9)


def test_bends_are_in_the_axes_of_the_section() -> None:
    still, rolled = Scenario(name="still"), Scenario(name="roll", shaft=(ROLL,))
    bend, turned = (_state(_bent(scenario)) for scenario in (still, rolled))
    assert turned.bend_rad == pytest.approx(bend.bend_rad, abs=1e-9)
    x, y, z = bend.tip.position
    c, s = cos(radians(10.0)), sin(radians(10.0))
    assert turned.tip.position == pytest.approx((c * x - s * y, s * x + c * y, z), abs=1e-9)


def test_a_misaligned_camera_rotates_only_the_picture() -> None:
    angle = 0.25
    scenario = Scenario(name="still")
    straight, turned = _bent(scenario), _bent(scenario, misalignment_rad=angle)
    assert _state(turned).bend_rad == _state(straight).bend_rad
    assert turned.tip_pose() == straight.tip_pose()
    for plant in (straight, turned):
        plant.draw_board()
    pixels = []
    for misalignment in (0.0, angle):
        rig = TwinRig(
            scenario, instrument=Instrument(misalignment_rad=misalignment), pictures=False
        )
        with rig:
            rig.actuators.enable()
            rig.plant.data.ctrl[:] = [0.3, 0.2]
            rig.clock.sleep_until(1.0)
            pixels.append(np.subtract(rig.truth.now().target_px, rig.camera.calibration.centre_px))
    # a camera turned clockwise sees the scene turned counter-clockwise, about the centre
    c, s = cos(angle), sin(angle)
    assert pixels[1] == pytest.approx(np.array([[c, s], [-s, c]]) @ pixels[0], abs=1e-6)


def test_weight_bends_the_section_down_at_any_roll() -> None:
    """A straight section hangs down; after a quarter turn of the shaft, towards its side."""
    hanging = Scenario(name="hanging", gravity=True)
    plant = TwinPlant(hanging, Instrument(), Numerics(), 0)
    plant.advance(1000)
    up_down, left_right = _state(plant).bend_rad
    assert up_down < -0.005  # 15 g at half of 90 mm against 0.05 N m/rad and the wires
    assert left_right == pytest.approx(0.0, abs=1e-9)
    assert _state(plant).tip.position[1] > 0  # y is down


def test_a_push_moves_the_tip_and_friction_keeps_part_of_it() -> None:
    push = Push(start_s=0.2, over_s=0.6, force_n=1.0, direction_deg=0.0)
    plant = TwinPlant(Scenario(name="push", push=(push,)), Instrument(), Numerics(), 0)
    plant.advance(250)
    during = _state(plant)
    plant.advance(1500)
    after = _state(plant)
    assert during.tip.position[0] > 0.001  # to the right
    assert during.bend_rad[1] > radians(1.0)
    assert 0.0 < after.bend_rad[1] < during.bend_rad[1]  # springs back within its hysteresis
    assert abs(after.bend_rad[0]) < 1e-6


def test_a_bend_of_the_shaft_alone_does_not_move_the_tip() -> None:
    """All four wires have the same tension, whatever its size."""
    bend = Shaft(kind="bend", start_s=0.0, over_s=1.0, by_deg=-180.0)
    plant = TwinPlant(Scenario(name="bend", shaft=(bend,)), Instrument(), Numerics(), 0)
    tight = sum(plant.snapshot().tensions[1])
    plant.advance(1000)
    assert plant.course.shaft_bend_rad(plant.t) == pytest.approx(0.0, abs=1e-12)
    assert _state(plant).bend_rad == pytest.approx((0.0, 0.0), abs=1e-9)
    assert sum(plant.snapshot().tensions[1]) < tight  # springs in series are softer without cosh
    assert pi * plant.instrument.conduit_friction > 0.4  # ... so much less of it
