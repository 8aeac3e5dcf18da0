"""Every kind of camera model: closed forms, and pixels to rays and back."""

from dataclasses import replace
from math import hypot, radians, tan
from typing import Literal

import numpy as np
import pytest

from endolock.hw.api import Calibration
from endolock.twin.camera import optics
from endolock.twin.world.scenario_sections import CameraSettings
from endolock.vision import camera_model

FISHEYE = optics.calibration(CameraSettings(projection="equidistant", diagonal_deg=120.0))
PINHOLE = camera_model.from_fovy(640, 480, 85.0)
CAMERAS = {
    "pinhole": PINHOLE,
    "pinhole with distortion": replace(
        PINHOLE, aspect=1.09, distortion=(-0.1, 0.02, 1e-3, -1e-3, 0.0)
    ),
    "fisheye": FISHEYE,
    "fisheye, oblong pixels": replace(FISHEYE, aspect=0.94),
    "fisheye with distortion": replace(FISHEYE, distortion=(0.02, -0.01, 0.002, 0.0)),
}


@pytest.mark.parametrize("angle_deg", [0.0, 1.0, 30.0, 59.9, 80.0])
def test_an_equidistant_fisheye_shows_angles_as_lengths(angle_deg: float) -> None:
    theta = radians(angle_deg)
    u, v = camera_model.project(FISHEYE, np.array([0.6 * tan(theta), 0.8 * tan(theta), 1.0]))
    right, down = camera_model.offset(FISHEYE, (u, v))
    assert hypot(right, down) == pytest.approx(FISHEYE.focal_px * theta, abs=1e-9)  # rounding
    assert camera_model.off_axis_angle(FISHEYE, (u, v)) == pytest.approx(theta, abs=1e-12)


def test_its_corners_span_the_given_field_of_view() -> None:
    assert 2 * camera_model.off_axis_angle(FISHEYE, (-0.5, -0.5)) == pytest.approx(radians(120))


@pytest.mark.parametrize("name", CAMERAS)
def test_pixels_and_rays_are_inverse(name: str) -> None:
    camera = CAMERAS[name]
    grid = np.stack(np.meshgrid(np.linspace(60, 580, 14), np.linspace(40, 440, 11)), -1)
    pixels = grid.reshape(-1, 2)
    back = camera_model.project_points(camera, camera_model.rays(camera, pixels))
    # closed forms to rounding; OpenCV undistorts iteratively, to a few thousandths of a pixel
    assert back == pytest.approx(pixels, abs=0.05 if camera.distortion else 1e-9)


@pytest.mark.parametrize("name", CAMERAS)
def test_one_point_and_many_agree(name: str) -> None:
    camera = CAMERAS[name]
    points = np.array([[0.02, -0.01, 0.1], [0.0, 0.0, 0.05], [-0.05, 0.03, 0.08]])
    many = camera_model.project_points(camera, points)
    for point, pixel in zip(points, many, strict=True):
        assert camera_model.project(camera, point) == pytest.approx(tuple(pixel), abs=1e-9)
        assert camera_model.ray(camera, tuple(pixel)) == pytest.approx(point / point[2], abs=1e-3)


@pytest.mark.parametrize("name", CAMERAS)
def test_the_jacobian_is_the_derivative_of_the_projection(name: str) -> None:
    camera = CAMERAS[name]
    points = np.array([[0.02, -0.01, 0.1], [0.001, 0.0, 0.05], [-0.05, 0.03, 0.08]])
    slope = camera_model.jacobian(camera, points)
    move = np.array([3e-7, -2e-7, 4e-7])
    ahead = camera_model.project_points(camera, points + move)
    behind = camera_model.project_points(camera, points - move)
    # moves of a micron at 1e4 px/m are 1e-2 px, with an error of the third order below 1e-8
    assert (slope @ (2 * move)) == pytest.approx(ahead - behind, abs=1e-6)


@pytest.mark.parametrize("mask", ["none", "octagon", "circle"])
@pytest.mark.parametrize("size", [(64, 48), (72, 57)])
def test_both_mask_functions_agree(
    mask: Literal["none", "octagon", "circle"], size: tuple[int, int]
) -> None:
    width, height = size
    camera = Calibration(
        width=width, height=height, focal_px=40.0, centre_px=(32.0, 24.0), mask=mask
    )
    shown = camera_model.visible(camera)
    assert shown.shape == (height, width)
    for v, u in np.ndindex(height, width):
        assert camera_model.in_picture(camera, (u, v)) == shown[v, u]
    corners = shown[[0, 0, -1, -1], [0, -1, 0, -1]]
    assert corners.all() if mask == "none" else not corners.any()
    assert not camera_model.in_picture(camera, (float("nan"), 3.0))
