"""Rotations against scipy's, and against each other."""

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from endolock.hw import rotation

VECTORS = st.tuples(*[st.floats(-1.7, 1.7)] * 3)  # less than pi long, where the vector is unique
ROUNDING = 1e-12


@given(VECTORS)
def test_quaternion_vector_and_matrix_agree_with_scipy(
    vector: tuple[float, float, float],
) -> None:
    expected = Rotation.from_rotvec(vector)
    quaternion = rotation.from_vector(vector)
    assert quaternion == pytest.approx(expected.as_quat(scalar_first=True), abs=ROUNDING)
    assert rotation.to_matrix(quaternion) == pytest.approx(expected.as_matrix(), abs=ROUNDING)
    assert rotation.to_vector(quaternion) == pytest.approx(vector, abs=1e-9)  # near 0 and pi


@given(VECTORS)
def test_a_quaternion_and_its_negative_mean_the_same(vector: tuple[float, float, float]) -> None:
    w, x, y, z = rotation.from_vector(vector)
    assert rotation.to_vector((-w, -x, -y, -z)) == pytest.approx(vector, abs=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.3, 2.0, pi - 1e-9, pi])
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0.0, -0.8)])
def test_a_matrix_gives_its_quaternion_back(axis: tuple[float, float, float], angle: float) -> None:
    matrix = Rotation.from_rotvec(angle * np.array(axis)).as_matrix()
    back = rotation.to_matrix(rotation.from_matrix(matrix))
    assert back == pytest.approx(matrix, abs=ROUNDING)


@given(VECTORS, VECTORS)
def test_a_product_turns_by_the_second_first(
    first: tuple[float, float, float], second: tuple[float, float, float]
) -> None:
    a, b = rotation.from_vector(first), rotation.from_vector(second)
    both = rotation.to_matrix(rotation.product(a, b))
    assert both == pytest.approx(rotation.to_matrix(a) @ rotation.to_matrix(b), abs=ROUNDING)


def test_about_z_turns_x_towards_y() -> None:
    assert rotation.matrix_about_z(0.3) == pytest.approx(
        rotation.to_matrix(rotation.about((0.0, 0.0, 1.0), 0.3)), abs=ROUNDING
    )
    assert (rotation.matrix_about_z(pi / 2) @ [1, 0, 0]) == pytest.approx((0, 1, 0), abs=ROUNDING)


def test_no_rotation_has_no_vector() -> None:
    assert rotation.from_vector((0.0, 0.0, 0.0)) == (1.0, 0.0, 0.0, 0.0)
    assert rotation.to_vector((1.0, 0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
