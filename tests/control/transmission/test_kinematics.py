"""Constant curvature against closed forms, finite differences and the twin's own geometry."""

from math import cos, pi, sin
from typing import Literal

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.control.transmission import kinematics
from endolock.control.transmission.kinematics import SectionGeometry
from endolock.hw.api import Calibration, ConfigError
from endolock.twin.rig import TwinRig
from endolock.twin.world.instrument import Instrument
from endolock.vision import camera_model

SECTION = SectionGeometry()
BENDS = st.tuples(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2))


def test_straight_is_the_base_frame() -> None:
    position, rotation = kinematics.forward(SECTION, (0.0, 0.0))
    assert position == pytest.approx((0, 0, 0), abs=1e-15)  # rounding of 0.09 m
    assert np.array_equal(rotation, np.eye(3))


@pytest.mark.parametrize("t", [1e-9, 1e-5, 0.3, pi / 2, 2.5])
def test_a_bend_in_one_plane_is_an_arc(t: float) -> None:
    """To the right: x = L/t (1 - cos t) + l sin t, z = L/t sin t + l cos t - L - l."""
    length, tip = SECTION.bending_length_m, SECTION.rigid_tip_m
    x = length / t * (2 * sin(t / 2) ** 2) + tip * sin(t)
    z = length / t * sin(t) + tip * cos(t) - length - tip
    position, rotation = kinematics.forward(SECTION, (0.0, t))
    assert position == pytest.approx((x, 0, z), abs=1e-12)  # series and quotients in double
    assert rotation @ [0, 0, 1] == pytest.approx((sin(t), 0, cos(t)), abs=1e-12)
    up, _ = kinematics.forward(SECTION, (t, 0.0))
    assert up == pytest.approx((0, -x, z), abs=1e-12)


@given(bend=BENDS)
def test_orientation_is_a_rotation_by_the_bend(bend: tuple[float, float]) -> None:
    _, rotation = kinematics.forward(SECTION, bend)
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)  # rounding
    quaternion, vector = np.empty(4), np.empty(3)
    mujoco.mju_mat2Quat(quaternion, rotation.ravel())
    mujoco.mju_quat2Vel(vector, quaternion, 1.0)
    assert vector == pytest.approx((*bend, 0.0), abs=1e-9)  # square roots near no bend at all


@given(bend=BENDS)
def test_moving_along_the_arc_moves_along_the_tip(bend: tuple[float, float]) -> None:
    """A longer section only pushes its rigid tip ahead along the optical axis."""
    longer = SectionGeometry(rigid_tip_m=SECTION.rigid_tip_m + 0.01)
    here, rotation = kinematics.forward(SECTION, bend)
    there, _ = kinematics.forward(longer, bend)
    assert there - here == pytest.approx(0.01 * (rotation[:, 2] - [0, 0, 1]), abs=1e-12)


@given(bend=BENDS, distance_m=st.floats(0.01, 0.5))
def test_aim_inverts_forward(bend: tuple[float, float], distance_m: float) -> None:
    position, rotation = kinematics.forward(SECTION, bend)
    target = position + distance_m * rotation[:, 2]
    # 1e-15 m of rounding in a target 10 mm ahead turn the axis by 1e-13 rad; 1e-12 m is no offset
    assert kinematics.aim(SECTION, target) == pytest.approx(bend, abs=1e-9)


def test_a_target_behind_is_aimed_at_with_the_largest_bend() -> None:
    bend = kinematics.aim(SECTION, np.array([0.05, 0.0, -1.0]))
    assert bend == pytest.approx((0.0, kinematics.LARGEST_BEND_RAD))


@pytest.mark.parametrize("sizes", [(0.0, 0.01), (-0.1, 0.01), (0.07, -0.001), (float("nan"), 0.0)])
def test_impossible_sections_are_refused(sizes: tuple[float, float]) -> None:
    with pytest.raises(ConfigError, match="use a length above 0 and a tip of 0 or more"):
        SectionGeometry(bending_length_m=sizes[0], rigid_tip_m=sizes[1])


@pytest.mark.parametrize("misalignment", [0.0, 0.25])
@pytest.mark.parametrize("bend", [(0.0, 0.6), (0.5, 0.0), (0.4, -0.4)])
def test_the_twin_bends_nearly_with_constant_curvature(
    bend: tuple[float, float], misalignment: float
) -> None:
    made = Instrument(misalignment_rad=misalignment)
    plant = TwinRig("rest", instrument=made, pictures=False).plant
    for i in range(1, 13):
        axis = "up_down" if i % 2 else "left_right"
        plant.data.joint(f"hinge_{axis}_{i}").qpos = bend[0 if i % 2 else 1] / 6
    plant.step_count += 1  # positions were changed behind its back
    truth, _ = plant.explain(plant.snapshot())
    geometry = SectionGeometry(misalignment_rad=misalignment)
    expected, rotation = kinematics.forward(geometry, truth.bend_rad)
    # six alternating hinges an axis: the axes' planes lie half a pitch, 3 mm, apart along the tip,
    # which tilts by up to 0.6 rad
    assert truth.tip.position == pytest.approx(expected, abs=0.0031 * 0.6 + 1e-4)
    # rotations about two axes do not commute
    assert truth.bend_rad == pytest.approx(bend, abs=0.02)
    assert truth.tip.matrix == pytest.approx(rotation, abs=0.03)


@pytest.mark.parametrize("projection", ["pinhole", "equidistant"])
@pytest.mark.parametrize("misalignment", [0.0, 0.3])
@pytest.mark.parametrize("size", [0.0, 1e-6, 1e-3, 0.4, 1.2])
def test_image_jacobian_is_the_derivative_of_the_pixel(
    projection: Literal["pinhole", "equidistant"], misalignment: float, size: float
) -> None:
    camera = Calibration(
        width=640, height=480, focal_px=262.0, centre_px=(319.5, 239.5), projection=projection
    )
    geometry = SectionGeometry(misalignment_rad=misalignment)
    bend = (0.6 * size, -0.8 * size)
    position, rotation = kinematics.forward(geometry, bend)
    target = position + rotation @ np.array([0.03, -0.02, 0.12])
    step = 1e-6

    def pixel(up_down: float, left_right: float) -> np.ndarray:
        place, turn = kinematics.forward(geometry, (up_down, left_right))
        return np.array(camera_model.project(camera, turn.T @ (target - place)))

    (a, b) = bend
    slopes = [pixel(a + step, b) - pixel(a - step, b), pixel(a, b + step) - pixel(a, b - step)]
    expected = np.array(slopes).T / (2 * step)
    found = kinematics.image_jacobian(geometry, camera, bend, target)
    # Differences of 1e-6 rad lose 1e-7 px/rad to rounding; up to 1e-4 rad the series is cut at t^2.
    assert np.abs(found - expected).max() < 1e-4


def test_misalignment_turns_the_picture_and_moves_nothing() -> None:
    straight, turned = SectionGeometry(), SectionGeometry(misalignment_rad=0.3)
    place, rotation = kinematics.forward(straight, (0.4, -0.2))
    same, other = kinematics.forward(turned, (0.4, -0.2))
    assert same == pytest.approx(place)
    expected = rotation @ np.array(
        [[np.cos(0.3), -np.sin(0.3), 0.0], [np.sin(0.3), np.cos(0.3), 0.0], [0.0, 0.0, 1.0]]
    )
    assert other == pytest.approx(expected, abs=1e-12)  # rounding
