"""Closed forms of the pinhole camera."""

from math import atan, hypot, isnan, radians, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.vision import camera_model

CAMERA = camera_model.from_fovy(640, 480, 85.0)


def test_the_default_camera_has_f_262() -> None:
    assert CAMERA.focal_px == pytest.approx(240 / tan(radians(42.5)))
    assert CAMERA.focal_px == pytest.approx(262, abs=0.5)  # stated to three digits
    assert CAMERA.centre_px == (319.5, 239.5)


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.01, 2))
def test_projection_is_the_camera_matrix(x: float, y: float, z: float) -> None:
    u, v, w = CAMERA.matrix @ [x, y, z]
    assert camera_model.project(CAMERA, np.array([x, y, z])) == pytest.approx((u / w, v / w))


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-2, 0))
def test_targets_behind_the_camera_are_not_seen(x: float, y: float, z: float) -> None:
    pixel = camera_model.project(CAMERA, np.array([x, y, z]))
    assert all(isnan(c) for c in pixel)
    assert not camera_model.in_picture(CAMERA, pixel)


@pytest.mark.parametrize(
    ("pixel", "inside"),
    [((0, 0), True), ((-0.5, 0), True), ((-0.51, 0), False), ((639.4, 479.4), True)]
    + [((639.5, 0), False), ((0, 479.5), False)],
)
def test_the_picture_reaches_half_a_pixel_beyond_its_centres(
    pixel: tuple[float, float], inside: bool
) -> None:
    assert camera_model.in_picture(CAMERA, pixel) is inside


@given(st.floats(-300, 300), st.floats(-200, 200))
def test_the_off_axis_angle_is_that_of_the_ray(right: float, down: float) -> None:
    u, v = CAMERA.centre_px
    angle = camera_model.off_axis_angle(CAMERA, (u + right, v + down))
    # adding and subtracting the centre costs 1e-13 px
    assert angle == pytest.approx(atan(hypot(right, down) / CAMERA.focal_px), abs=1e-12)
