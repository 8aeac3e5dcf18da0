"""Ego-motion against a scene that is turned exactly: pictures warped by a known rotation."""

import cv2
import numpy as np
import pytest

from endolock.hw.api import Frame, Image, Vector
from endolock.twin.model import tissue
from endolock.vision import camera_model
from endolock.vision.ego_motion import EgoMotion, Rotation

CAMERA = camera_model.from_fovy(640, 480, 85.0)
SCENE = np.asarray(cv2.resize(tissue.picture(512, 96.0, 3), (1024, 1024)), np.uint8)


@pytest.mark.parametrize("vector", [(0.01, 0.0, 0.0), (0.0, -0.02, 0.0), (0.006, 0.004, -0.03)])
def test_a_pure_rotation_is_found(vector: tuple[float, float, float]) -> None:
    turned = _compare(np.array(vector))
    # 150 points to 0.05-0.1 px of f = 262 px: 3e-5 rad, and bilinear warping costs as much
    assert turned.vector == pytest.approx(vector, abs=2e-4)


def test_the_covariance_matches_the_scatter() -> None:
    random = np.random.default_rng(4)
    off, expected = [], []
    for _ in range(25):
        vector = random.normal(0, 0.006, 3)
        turned = _compare(vector, random)
        off.append(turned.vector - vector)
        expected.append(turned.covariance)
    scatter = np.mean([o @ np.linalg.solve(c, o) for o, c in zip(off, expected, strict=True)]) / 3
    # points are not independent, and warping has errors of its own
    assert 0.2 < scatter < 5


def test_a_moving_region_can_be_left_out() -> None:
    vector = np.array([0.01, 0.005, 0.0])
    before, after = _picture(np.zeros(3)), _picture(vector)
    patch = SCENE[600:850, 600:900]
    before[100:350, 150:450], after[100:350, 170:470] = patch, patch
    corners = np.array([[145.0, 95], [475, 95], [475, 355], [145, 355]])
    ego = EgoMotion(CAMERA)
    ego(_frame(before, 0))
    turned = ego(_frame(after, 1), moving=corners)
    assert isinstance(turned, Rotation)
    assert turned.vector == pytest.approx(vector, abs=5e-4)  # fewer points, all near the edge


def test_refusals_have_reasons() -> None:
    ego = EgoMotion(CAMERA)
    assert ego(_frame(_picture(np.zeros(3)), 0)) == "no previous frame"
    assert ego(_frame(np.zeros((480, 640, 3), np.uint8), 1)) == "picture is black"
    plain = np.full((480, 640, 3), 120, np.uint8)
    ego(_frame(plain, 2))
    assert ego(_frame(plain, 3)) == "background has too little texture"


def _compare(vector: Vector, noise: np.random.Generator | None = None) -> Rotation:
    ego = EgoMotion(CAMERA)
    for n, turn in enumerate((np.zeros(3), vector)):
        image = _picture(turn)
        if noise:
            image = np.clip(image + noise.normal(0, 4, image.shape), 0, 255).astype(np.uint8)
        turned = ego(_frame(image, n))
    assert isinstance(turned, Rotation)
    assert (turned.since, turned.seq) == (0, 1)
    return turned


def _picture(vector: Vector) -> Image:
    """Return the picture of an infinitely distant scene after a rotation of the camera."""
    inner = np.array([[200.0, 0, 511.5], [0, 200.0, 511.5], [0, 0, 1]])
    turn = cv2.Rodrigues(np.asarray(vector, np.float64))[0]
    # a ray r of the turned camera is R r in the scene
    matrix = inner @ turn @ np.linalg.inv(CAMERA.matrix)
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(SCENE, matrix, (640, 480), flags=flags), np.uint8)


def _frame(image: Image, seq: int) -> Frame:
    return Frame(image=image, t_capture=0.0, t_available=0.0, seq=seq, dropped=0)
