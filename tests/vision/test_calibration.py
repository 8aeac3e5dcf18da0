"""Calibration finds the cameras of the pictures, and files preserve them."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from endolock.hw.api import Calibration, ConfigError
from endolock.hw.camera import camera_file
from endolock.twin.camera.stills import BoardPose, Studio
from endolock.twin.world import scenario
from endolock.vision import calibration
from endolock.vision.detector import Marker, MarkerDetector
from endolock.vision.grey import grey_of, smoothed

FISHEYE = {"camera.projection": "equidistant", "camera.mask": "octagon"}


@pytest.mark.parametrize(
    ("overrides", "projection"), [({}, "pinhole"), (FISHEYE, "equidistant")], ids=str
)
def test_a_rendered_camera_is_found(
    overrides: dict[str, Any], projection: Literal["pinhole", "equidistant"]
) -> None:
    true, board, views = _views(overrides, tilt_deg=45.0)
    found = calibration.calibrate(views, board, (640, 480), projection)
    # corners to 0.15-0.3 px in 30 views; OpenCV's own deviation of f is 0.1 %
    assert found.focal_px == pytest.approx(true.focal_px, rel=0.005)
    assert found.aspect == pytest.approx(1.0, abs=0.002)
    assert found.centre_px == pytest.approx(true.centre_px, abs=1.5)
    assert found.rms_px < 0.6
    assert len(found.date) == 10


def test_pictures_from_one_direction_are_refused() -> None:
    _, board, views = _views({}, tilt_deg=0.0)
    with pytest.raises(ConfigError, match=r"differ by \d+ deg, 25 needed"):
        calibration.calibrate(views, board, (640, 480))


def test_too_few_pictures_are_refused() -> None:
    _, board, views = _views({}, tilt_deg=45.0, count=5)
    with pytest.raises(ConfigError, match="in 5 pictures, 10 needed"):
        calibration.calibrate(views, board, (640, 480))


def test_a_calibration_is_unchanged_by_writing_and_reading(tmp_path: Path) -> None:
    camera = Calibration(
        width=720,
        height=576,
        focal_px=401.25,
        centre_px=(358.5, 290.25),
        aspect=1.09,
        projection="equidistant",
        distortion=(0.01, -0.002, 0.0, 0.0),
        mask="octagon",
        rms_px=0.21,
        date="2026-11-23",
    )
    path = tmp_path / "camera.toml"
    camera_file.write(camera, path)
    assert camera_file.read(path) == camera
    path.write_text("[run]\nx = 1\n[calibration]\n" + path.read_text())
    assert camera_file.read(path) == camera  # as in run.toml


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ("focal_px = -3.0", "focal_px: got -3 px, wanted 6.4 to 1280 px; give pixels"),
        ('projection = "orthographic"', "projection"),
        ("focal = 3.0", "unknown key focal"),
        ("width", "is not TOML"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(tmp_path: Path, change: str, why: str) -> None:
    path = tmp_path / "camera.toml"
    key = change.split(" ", maxsplit=1)[0]
    camera = Calibration(width=64, height=48, focal_px=50.0, centre_px=(31.5, 23.5))
    camera_file.write(camera, path)
    lines = [line for line in path.read_text().splitlines() if not line.startswith(f"{key} ")]
    path.write_text("\n".join([change, *lines]))
    with pytest.raises(ConfigError, match=why):
        camera_file.read(path)
    with pytest.raises(ConfigError, match="cannot read calibration"):
        camera_file.read(tmp_path / "none.toml")


def _views(
    overrides: dict[str, Any], *, tilt_deg: float, count: int = 30
) -> tuple[Calibration, Any, list[list[Marker]]]:
    random = np.random.default_rng(3)
    with Studio(scenario.load("rest", overrides)) as studio:
        detect = MarkerDetector(studio.board)
        views = []
        for _ in range(count):
            distance = random.uniform(0.05, 0.12)
            x, y = random.uniform([-0.4, -0.3], [0.4, 0.3]) * distance
            tilt, axis, roll = random.uniform([-tilt_deg, 0, -40], [tilt_deg + 0.1, 180, 40])
            still = studio.take(BoardPose((x, y, distance), tilt, axis, roll))
            assert still.frame.image is not None
            views.append(detect(smoothed(grey_of(still.frame.image))))
        return replace(studio.calibration), studio.board, views
