"""Ego-motion against a scene that is turned exactly: pictures warped by a known rotation.

Ego-motion on rendered pictures is in test_turning.py.
"""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from endolock.hw.api import Frame, Image, Vector
from endolock.twin.model import tissue
from endolock.vision import camera_model
from endolock.vision.background import TOO_LITTLE, Background
from endolock.vision.ego_motion import EgoMotion
from endolock.vision.observation import Turn

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
    ego, made = EgoMotion(CAMERA, 0.0), Background(CAMERA)
    ego(_frame(before, 0), made.beside_window((299.5, 224.5), 155.0))
    turned = ego(_frame(after, 1), made.beside_window((319.5, 224.5), 155.0))
    assert isinstance(turned, Turn)
    assert turned.vector == pytest.approx(vector, abs=5e-4)  # fewer points, all near the edge


def test_refusals_have_reasons() -> None:
    ego = EgoMotion(CAMERA)
    assert ego(_frame(_picture(np.zeros(3)), 0)) == "no previous frame"
    assert ego(_frame(np.zeros((480, 640, 3), np.uint8), 1)) == "picture is black"
    assert (
        ego(_frame(_picture(np.zeros(3)), 2), Background(CAMERA).beside_window((320, 240), 400.0))
        == TOO_LITTLE
    )


def test_a_picture_without_texture_is_refused() -> None:
    ego = EgoMotion(CAMERA)
    plain = np.full((480, 640, 3), 120, np.uint8)
    ego(_frame(plain, 0))
    assert ego(_frame(plain, 1)) == "0 points of the background followed, 12 needed"


@pytest.mark.parametrize("light", [12.0, 0.02])
def test_noise_is_no_background(light: float) -> None:
    """A dark wall, and one whose texture is lost in the noise of the camera."""
    random, ego = np.random.default_rng(2), EgoMotion(CAMERA)
    scene = light * _picture(np.zeros(3)) if light < 1 else np.full((480, 640, 3), light)
    found = []
    for n in range(5):
        image = np.clip(scene + random.normal(0, 4, scene.shape), 0, 255).astype(np.uint8)
        found.append(ego(_frame(image, n)))
    assert all(isinstance(turn, str) for turn in found), found


def test_halves_that_part_are_refused() -> None:
    before, after = _picture(np.zeros(3)), _picture(np.zeros(3))
    ego = EgoMotion(CAMERA)
    ego(_frame(before, 0))
    after[:, :320], after[:, 320:] = before[:, 6:326], np.roll(before, 6, axis=0)[:, 320:]
    said = ego(_frame(after, 1))
    assert isinstance(said, str)
    assert "one rotation" in said


def test_a_frame_that_cannot_be_used_is_bridged() -> None:
    """Black, blank and repeated frames: the next rotation is since the last good one."""
    ego = EgoMotion(CAMERA, 0.0)
    ego(_frame(_picture(np.zeros(3)), 0))
    for n, bad in enumerate((0, 120), 1):
        assert isinstance(ego(_frame(np.full((480, 640, 3), bad, np.uint8), n)), str)
    assert ego(replace(_frame(_picture(np.zeros(3)), 3), repeated=True)) == "picture repeated"
    turned = ego(_frame(_picture(np.array([0.0, 0.02, 0.0])), 4))
    assert isinstance(turned, Turn)
    assert turned.since_s == 0.0
    assert turned.vector == pytest.approx((0.0, 0.02, 0.0), abs=2e-4)


def test_parallax_is_not_taken_for_rotation() -> None:
    """A wall 0.2 m ahead of a camera 0.05 m in front of the point about which it turns."""
    ego, lever_m = EgoMotion(CAMERA, 0.05), 0.05
    places = [0.03 * np.sin(0.7 * n) * np.array([0.5, 1.0, 0.0]) for n in range(12)]
    off, step = [], []
    for n, vector in enumerate(places):
        turned = ego(_frame(_picture(vector, lever_m / 0.2), n))
        if n > 3:  # the first few pairs tell the depth
            assert isinstance(turned, Turn)
            off.append(turned.vector - (vector - places[n - 1]))
            step.append(vector - places[n - 1])
    # 1 % of the rotations; taken for rotation, parallax would make them 25 % too large
    assert np.linalg.norm(off) < 0.01 * np.linalg.norm(step)


def _compare(vector: Vector, noise: np.random.Generator | None = None) -> Turn:
    ego = EgoMotion(CAMERA, 0.0)
    for n, turn in enumerate((np.zeros(3), vector)):
        image = _picture(turn)
        if noise:
            image = np.clip(image + noise.normal(0, 4, image.shape), 0, 255).astype(np.uint8)
        turned = ego(_frame(image, n))
    assert isinstance(turned, Turn)
    assert turned.since_s == 0.0
    return turned


def _picture(vector: Vector, near: float = 0.0) -> Image:
    """Return the picture of a wall after a rotation of the camera, at rest seen face to face.

    Args:
        vector: rotation of the camera [rad].
        near: the lever over the distance of the wall [1].
    """
    inner = np.array([[200.0, 0, 511.5], [0, 200.0, 511.5], [0, 0, 1]])
    turn = cv2.Rodrigues(np.asarray(vector, np.float64))[0]
    # A ray r of the turned camera is R r in the scene; the camera has moved by L (R - 1) e_z.
    ahead = np.array([0.0, 0.0, 1.0])
    moved = near * (turn @ ahead - ahead)
    plane = np.eye(3) + np.outer(moved, ahead) / (1 - moved[2])
    matrix = inner @ plane @ turn @ np.linalg.inv(CAMERA.matrix)
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(SCENE, matrix, (640, 480), flags=flags), np.uint8)


def _frame(image: Image, seq: int) -> Frame:
    return Frame(image=image, t_capture=0.04 * seq, t_available=0.0, seq=seq, dropped=0)
