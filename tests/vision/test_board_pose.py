"""Pose of the board from exact and from noisy corners, with a pinhole and with a fisheye."""

import cv2
import numpy as np
import pytest

from endolock.hw import boards
from endolock.hw.api import Calibration, Vector
from endolock.twin.camera import optics
from endolock.twin.world.scenario_sections import CameraSettings
from endolock.vision import board_pose, camera_model

CAMERAS = {
    "pinhole": camera_model.from_fovy(640, 480, 85.0),
    "fisheye": optics.calibration(CameraSettings(projection="equidistant", diagonal_deg=140.0)),
}
POINTS = np.concatenate(list(boards.standard().corners().values()))
TURN = np.asarray(cv2.Rodrigues(np.array([0.4, -0.3, 0.2]))[0], np.float64)
PLACE = np.array([0.02, -0.01, 0.11])


@pytest.mark.parametrize("name", CAMERAS)
def test_exact_corners_give_the_exact_pose(name: str) -> None:
    pose = board_pose.fit(CAMERAS[name], POINTS, _seen(CAMERAS[name]))
    assert pose is not None
    # two Gauss-Newton steps from the pose of SQPNP, which is worse at the edge of a fisheye
    assert pose.rotation == pytest.approx(TURN, abs=1e-6)
    assert pose.translation == pytest.approx(PLACE, abs=1e-7)
    assert np.abs(pose.misfit).max() < 1e-4


@pytest.mark.parametrize("name", CAMERAS)
def test_the_information_matches_the_scatter(name: str) -> None:
    camera, random = CAMERAS[name], np.random.default_rng(0)
    exact = _seen(camera)
    pixels, expected = [], np.zeros((2, 2))
    target = np.array([0.01, -0.02, 0.0])
    for _ in range(400):
        pose = board_pose.fit(camera, POINTS, exact + random.normal(0, 0.3, exact.shape))
        assert pose is not None
        _, pixel, gain = pose.locate(camera, target)
        pixels.append(pixel)
        expected = 0.3**2 * gain @ np.linalg.solve(pose.information, gain.T)
    # 400 draws: a variance is known to 7 %
    assert np.diag(np.cov(np.transpose(pixels))) == pytest.approx(np.diag(expected), rel=0.3)


def test_a_ray_meets_the_board_where_the_point_is_seen() -> None:
    camera = CAMERAS["fisheye"]
    pose = board_pose.fit(camera, POINTS, _seen(camera))
    assert pose is not None
    point = np.array([0.013, -0.007, 0.0])
    _, pixel, _ = pose.locate(camera, point)
    back = pose.under(camera_model.ray(camera, tuple(pixel)))
    assert back == pytest.approx(point, abs=1e-9)  # rounding


def test_impossible_corners_have_no_pose() -> None:
    camera = CAMERAS["fisheye"]
    beyond = np.full((len(POINTS), 2), 1e4)  # a fisheye sees nothing there
    assert board_pose.fit(camera, POINTS, beyond) is None


def _seen(camera: Calibration) -> Vector:
    return camera_model.project_points(camera, POINTS @ TURN.T + PLACE)
