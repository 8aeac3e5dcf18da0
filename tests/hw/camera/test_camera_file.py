"""Camera files: geometries that are believed, and those that cannot be true."""

from __future__ import annotations

from dataclasses import asdict, replace
from math import hypot, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from endolock.hw.api import Calibration, ConfigError
from endolock.hw.camera import camera_file, plausible_camera
from endolock.vision import camera_model

GOOD: dict[str, Any] = {"width": 640, "height": 480, "focal_px": 400.0, "centre_px": [319.5, 239.5]}
CORNER = hypot(320, 240) / 400
"""Where a corner of that picture is, relative to the focal length [1]."""


def read(folder: Path, **changes: Any) -> Calibration:
    """Write a camera file with changed values, and read it."""
    path = folder / "camera.toml"
    path.write_text(tomli_w.dumps(GOOD | changes))
    return camera_file.read(path)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"width": 640.5}, "width: should be a valid integer, got 640.5; give a whole number"),
        ({"width": "640"}, "width: should be a valid integer, got '640'"),
        ({"width": True}, "width: should be a valid integer, got true"),
        ({"height": 8}, "height: got 8 px, wanted 16 to 16384 px"),
        ({"focal_px": 0.62}, "focal_px: got 0.62 px, wanted 64 to 12800 px; give pixels, for pin"),
        ({"focal_px": float("nan")}, "focal_px: should be a finite number, got nan"),
        ({"focal_px": True}, "focal_px: should be a valid number, got true"),
        ({"centre_px": [3195.0, -20.0]}, "centre_px.0: got 3195 px, wanted 64 to 576 px; give pix"),
        ({"centre_px": [319.5, -20.0]}, "centre_px.1: got -20 px, wanted 48 to 432 px; give pixe"),
        ({"centre_px": [0.4992, 0.4989]}, "centre_px.0: got 0.4992 px, wanted 64 to 576 px; give"),
        ({"centre_px": [319.5]}, "centre_px"),
        ({"aspect": float("nan")}, "aspect: should be a finite number, got nan"),
        ({"aspect": 3}, "aspect: got 3, wanted 0.5 to 2"),
        ({"rms_px": -1}, "rms_px: got -1 px, wanted 0 to 10 px"),
        ({"date": "yesterday"}, "date: got 'yesterday', wanted YYYY-MM-DD"),
        ({"projection": "fisheye"}, "projection: should be 'pinhole' or 'equidistant', got 'fish"),
        ({"distortion": [0.1]}, "got 1 coefficients, wanted 0, 4, 5, 8, 12, 14 for pinhole"),
        ({"distortion": [0.1, 0.2, 0.3]}, "distortion: got 3 coefficients"),
        ({"distortion": [0.1] * 6}, "distortion: got 6 coefficients"),
        ({"distortion": [1e300, 0, 0, 0]}, "distortion.0: got 1e.300, wanted -10000 to 10000"),
        ({"distortion": [1000.0, 200.0, 5.0, 4.0, 2000.0]}, "moves a pixel outward: got 10"),
        ({"distortion": [0.1] * 5, "projection": "equidistant"}, "wanted 0, 4 for equidistant"),
        (
            {"distortion": [-1.15, 2.91, -2.48, 0.18], "projection": "equidistant"},
            "distortion: the picture folds within itself 4. deg off the axis",
        ),
        ({"focal": 400.0}, "unknown key focal; did you mean focal_px"),
        ({"calibration": 3}, "calibration is 3; make one with endolock calibrate"),
    ],
)
def test_a_camera_that_cannot_be_is_refused_in_one_line(
    changes: dict[str, Any], said: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        read(tmp_path, **changes)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"width": 720, "height": 576, "aspect": 1.09, "centre_px": [360, 288]},
        {"focal_px": 262},
        {"distortion": [-0.28, 0.09, 0.001, -0.0005]},
        {"distortion": [0.1, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]},
        {"distortion": [0.17, -0.03, 0.0004, -0.0007], "projection": "equidistant"},
        {"distortion": [0.0] * 4, "projection": "equidistant", "focal_px": 200.0},
    ],
)
def test_a_real_camera_is_believed_and_its_rays_are_right(
    changes: dict[str, Any], tmp_path: Path
) -> None:
    camera = read(tmp_path, **changes)
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 9), np.linspace(0, camera.height - 1, 7))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    rays = camera_model.rays(camera, pixels)
    ahead = np.isfinite(rays).all(axis=1)
    seen = camera_model.project_points(camera, rays[ahead])
    assert np.abs(seen - pixels[ahead]).max() < 0.5  # the reader allows as much
    assert ahead.all() or camera.focal_px == 200.0  # sees more than half a sphere
    assert ahead.mean() > 0.7


@pytest.mark.parametrize("factor", [-0.02, -0.05, -0.1, -0.13, -0.16, -0.2, -0.3, -1.0])
def test_a_picture_that_folds_is_refused(factor: float, tmp_path: Path) -> None:
    """R (1 + k r^2) turns back at r = 1/sqrt(-3 k), where it is 2/3 of that."""
    folds = 2 / 3 / sqrt(-3 * factor) < CORNER
    try:
        read(tmp_path, distortion=[factor, 0.0, 0.0, 0.0])
        refused = False
    except ConfigError as error:
        refused = "distortion" in error.what
    assert refused == folds


@pytest.mark.parametrize("name", ["ost.yaml", "cam.YML", "camera.json", "camera.xml"])
def test_a_file_of_another_program_is_refused(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text("image_width: 640\n")
    with pytest.raises(ConfigError, match="is not a TOML file; make one with endolock calibrate"):
        camera_file.read(path)


def test_a_camera_that_cannot_be_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "camera.toml"
    camera = Calibration(width=640, height=480, focal_px=400.0, centre_px=(319.5, 239.5))
    camera_file.write(camera, path)
    with pytest.raises(ConfigError, match="centre_px"):
        camera_file.write(replace(camera, centre_px=(0.5, 0.5)), path)
    assert camera_file.read(path) == camera
    assert asdict(camera)["distortion"] == ()


def test_a_file_is_checked_with_the_steps_that_vision_uses() -> None:
    assert plausible_camera.UNDISTORT == camera_model.UNDISTORT
