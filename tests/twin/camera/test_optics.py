"""Each part of the optics against its closed form, the fisheye against exact projection."""

from typing import Any

import numpy as np
import pytest

from endolock.hw.api import Image
from endolock.twin.camera import optics
from endolock.twin.camera.stills import BoardPose, Studio
from endolock.twin.world import scenario
from endolock.twin.world.scenario_sections import CameraSettings
from endolock.vision import camera_model
from endolock.vision.marker_eyes import MarkerEyes

GREY = np.full((480, 640, 3), 100, np.uint8)


def _developed(*pictures: Image, seed: int = 0, **camera: Any) -> np.ndarray:
    return optics.Optics(CameraSettings(**camera), seed).develop(pictures or [GREY])


def test_ideal_optics_leave_a_picture_unchanged() -> None:
    random = np.random.default_rng(0).integers(0, 255, GREY.shape, np.uint8)
    assert np.array_equal(_developed(random), random)


@pytest.mark.parametrize("diagonal_deg", [120.0, 140.0])
@pytest.mark.parametrize("mask", ["none", "octagon"])
def test_a_fisheye_shows_the_target_at_its_projection(diagonal_deg: float, mask: str) -> None:
    camera = {"projection": "equidistant", "diagonal_deg": diagonal_deg, "mask": mask}
    random = np.random.default_rng(2)
    overrides = {f"camera.{key}": value for key, value in camera.items()}
    off = []
    with Studio(scenario.load("rest", overrides)) as studio:
        eyes = MarkerEyes(studio.calibration, studio.board)
        for _ in range(12):
            x, y = random.uniform(-0.05, 0.05, 2)
            still = studio.take(BoardPose((x, y, 0.12), *random.uniform([-20, 0], [20, 180])))
            _, fit = eyes.look(still.frame)
            assert not isinstance(fit, str)
            off.append(np.hypot(*np.subtract(fit.pixel, still.target_px)))
    assert np.sqrt(np.mean(np.square(off))) <= 0.1  # acceptance limit; 0.02-0.05 measured


def test_the_rendered_picture_just_covers_the_fisheye() -> None:
    camera = CameraSettings(projection="equidistant", mask="octagon")
    fisheye, shot = optics.calibration(camera), optics.shot(camera)
    rays = np.array(
        [
            camera_model.ray(fisheye, (float(u), float(v)))
            for v, u in np.argwhere(camera_model.visible(fisheye))[::7]
        ]
    )
    pinhole = camera_model.from_fovy(*shot)
    seen = camera_model.project_points(pinhole, rays)
    assert all(camera_model.in_picture(pinhole, (u, v)) for u, v in seen)
    assert seen[:, 0].max() > shot.width - 8  # wider than needed by a few pixels at most


def test_a_mask_is_black_outside_and_changes_nothing_inside() -> None:
    for mask in ("octagon", "circle"):
        image = _developed(mask=mask)
        shown = camera_model.visible(optics.calibration(CameraSettings(mask=mask)))
        assert (image[~shown] == 0).all()
        assert (image[shown] == 100).all()


def test_vignette_and_gain_in_closed_form() -> None:
    image = _developed(vignette=0.5, gain=1.5)
    v, u = np.indices((480, 640))
    radius = np.hypot(u - 319.5, v - 239.5) / np.hypot(319.5, 239.5)
    # the share is kept in 255 steps and the product rounded
    assert np.abs(image[..., 0] - 150 * (1 - 0.5 * radius**4)).max() <= 1.0
    assert (_developed(gain=3.0) == 255).all()  # clipped at white


def test_noise_has_its_deviation_and_depends_on_its_seed() -> None:
    image = _developed(noise=6.0)
    # a million draws: 0.1 %; rounding to whole levels adds 1/12 to a variance of 36
    assert image.astype(float).std() == pytest.approx(6.0, rel=0.01)
    assert image.mean() == pytest.approx(100.0, abs=0.1)
    assert np.array_equal(image, _developed(noise=6.0))
    assert not np.array_equal(image, _developed(noise=6.0, seed=1))
    twice = optics.Optics(CameraSettings(noise=6.0), 0)
    assert not np.array_equal(twice.develop([GREY]), twice.develop([GREY]))


def test_an_exposure_is_the_mean_of_its_pictures() -> None:
    pictures = [np.full_like(GREY, level) for level in (40, 100, 160)]
    assert (_developed(*pictures) == 100).all()


def test_compression_changes_edges_and_not_flat_parts() -> None:
    # at quality 50 the mean of a block is kept in steps of 2 levels, at 20 in steps of 5
    assert np.abs(_developed(jpeg_quality=50).astype(int) - 100).max() <= 2
    edge = GREY.copy()
    edge[:, 321:] = 200
    spoilt = _developed(edge, jpeg_quality=20).astype(int)
    assert np.abs(spoilt - edge).max() > 10  # the block that the edge cuts through rings
    assert np.abs(spoilt[:, :300] - 100).max() <= 3


def test_light_of_the_tip_falls_with_the_square_of_the_distance() -> None:
    light = {"light.room": 0.0, "light.falls_off": True, "light.tip": 0.3}

    def brightness(distance_m: float) -> float:
        with Studio(scenario.load("rest", light)) as studio:
            still = studio.take(BoardPose((0.03, 0.004, distance_m)))
            assert still.frame.image is not None
            u, v = camera_model.project(studio.calibration, np.array([0.0, 0.004, distance_m]))
            window = still.frame.image[int(v) - 2 : int(v) + 3, int(u) - 2 : int(u) + 3]
            return float(window.mean())

    # between the markers is paper; the light is 3 mm beside the camera, and it is computed
    # at the corners of cells of 2 mm
    assert brightness(0.06) / brightness(0.12) == pytest.approx(4.0, rel=0.1)


def test_a_back_lit_board_is_visible_without_other_light() -> None:
    dark = {"light.room": 0.0, "light.tip": 0.0}
    for back, found in ((0.0, False), (1.0, True)):
        with Studio(scenario.load("rest", {**dark, "light.back": back})) as studio:
            still = studio.take(BoardPose((0.0, 0.0, 0.12)))
            _, fit = MarkerEyes(studio.calibration, studio.board).look(still.frame)
            assert (not isinstance(fit, str)) is found
