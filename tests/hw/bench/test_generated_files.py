"""Generated bench and camera files: each can be used, or is refused in one line."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from datetime import date
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from tests.hw.emulated import Emulated

from endolock.hw.api import AXES, Calibration, ConfigError
from endolock.hw.bench import bench_file
from endolock.hw.bench.bench_file import Bench
from endolock.hw.camera import camera_file
from endolock.hw.dynamixel import registers as reg
from endolock.vision import camera_model

BENCH: dict[str, Any] = {
    "baud": 1_000_000,
    "board": "rings",
    "handle": {
        axis: {
            "id": number,
            "direction": 1,
            "zero_counts": 2048,
            "ratio": 1.0,
            "range_rad": [-1.5, 1.5],
            "speed_rad_s": 3.5,
            "current_limit_a": 0.5,
        }
        for number, axis in enumerate(AXES, 1)
    },
    "camera": {
        "source": "/dev/video0",
        "latency_s": 0.4,
        "frame_rate_hz": 25.0,
        "video_timeout_s": 10.0,
    },
}
CAMERA: dict[str, Any] = {
    "width": 640,
    "height": 480,
    "focal_px": 400.0,
    "centre_px": [319.5, 239.5],
    "aspect": 1.0,
    "projection": "pinhole",
    "distortion": [-0.1, 0.02, 0.0, 0.0],
    "mask": "none",
    "rms_px": 0.2,
    "date": "2026-11-23",
}
ODD: list[Any] = [
    True, False, 0, 1, -1, 2, 3, 253, 400_000, 10**30, -0.0, 0.5, 1e-300, 1e300, nan, inf, -inf,
    "", "a", "1", "rings", "a\nb", "\x7f", [], [0.0], [0, 1], [1.0, -1.0], [True, 1.0], [-90, 90],
    ["a"], [[1]], [0.0] * 14, {}, {"a": 1}, [{"a": 1}], date(2026, 11, 23), "equidistant",
]  # fmt: skip
"""Values of any type, one of which takes the place of a good one."""


def altered(good: dict[str, Any], random: np.random.Generator) -> dict[str, Any]:
    """Return values of a file in which one or two are scaled, replaced, added or removed."""
    values = {key: dict(v) if isinstance(v, dict) else v for key, v in good.items()}
    for _ in range(random.integers(1, 3)):
        part = values
        while isinstance(part[key := str(random.choice(list(part)))], dict) and part[key]:
            part[key] = dict(part[key])
            if random.random() < 0.1:
                break
            part = part[key]
        way, old = random.integers(8), part[key]
        if old in ODD:
            continue
        if key == "distortion" and way < 6:
            count = random.choice([0, 4, 5, 8])
            part[key] = (random.uniform(-0.3, 0.5, count) * 10.0 ** -np.arange(count)).tolist()
        elif way < 6 and isinstance(old, float | list):
            scale = float(10 ** random.uniform(-1, 1))
            part[key] = (np.array(old) * scale).tolist()
        elif way == 6 and len(part) > 1:
            del part[key]
        elif random.random() < 0.1:
            part[str(random.choice(["latency", "ids", key.upper()]))] = old
        else:
            part[key] = ODD[random.integers(len(ODD))]
    return values


def try_all(
    count: int,
    seed: int,
    good: dict[str, Any],
    read: Callable[[Path], Any],
    use: Callable[[Any], None],
    path: Path,
) -> None:
    """Read altered files; each is used, or refused in one line that says what and what to do."""
    random = np.random.default_rng(seed)
    refusals = []
    for _ in range(count):
        path.write_text(tomli_w.dumps(altered(good, random)), encoding="utf-8")
        try:
            made = read(path)
        except ConfigError as error:
            refusals.append(str(error).replace(str(path), "FILE"))
        else:
            use(made)
    assert 0.3 * count < len(refusals) < 0.95 * count  # both are tried
    for line in refusals:
        assert "\n" not in line
        assert len(line) < 400
        assert " FILE: " in line  # it names the file, then what is wrong


def drive(made: Bench) -> None:
    """Turn the handles of a bench to and fro: every angle stays within its range."""
    handles = enumerate(made.handles.items(), 1)
    bench = Emulated(handles={a: h.model_copy(update={"id": n}) for n, (a, h) in handles})
    for servo, handle in zip(bench.servos, made.handles.values(), strict=True):
        servo._start((handle.zero_counts or 0) % reg.TURN)
    bench.wait(0.05)  # a block of zeros would be one without indirect addresses
    assert made.camera.geometry().focal_px > 0
    assert np.isfinite([made.camera.latency_s, made.camera.video_timeout_s]).all()
    with bench.guard as guard:
        guard.enable()
        for aim in (0.1, -0.1):
            for state in bench.follow(5, (aim, aim)):
                rows = zip(state.position, made.handles.values(), strict=True)
                for angle, handle in rows:
                    low, high = handle.range_rad
                    assert low - 0.01 <= angle <= high + 0.01  # a count, and the motor's lag


def look(camera: Calibration) -> None:
    """Every pixel has a ray, which is seen at that pixel, unless it is beside the camera."""
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 7), np.linspace(0, camera.height - 1, 5))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    rays = camera_model.rays(camera, pixels)
    ahead = np.isfinite(rays).all(axis=1)
    assert ahead.sum() >= len(pixels) / 3
    # less than two degrees before 90 deg a pixel of a fisheye is worth any number of turns
    good = ahead & (np.hypot(rays[:, 0], rays[:, 1]) < 30)
    seen = camera_model.project_points(camera, rays[good])
    assert np.abs(seen - pixels[good]).max() < 0.6  # `plausible_camera.BACK_PX`, between its pixels
    assert camera_model.visible(camera).any()


@pytest.mark.parametrize("seed", range(2))
def test_generated_bench_files(seed: int, tmp_path: Path) -> None:
    try_all(120, seed, BENCH, bench_file.load, drive, tmp_path / "bench.toml")


@pytest.mark.parametrize("seed", range(2))
def test_generated_camera_files(seed: int, tmp_path: Path) -> None:
    try_all(120, seed, CAMERA, camera_file.read, look, tmp_path / "camera.toml")


@pytest.mark.slow
def test_many_generated_files(tmp_path: Path) -> None:
    seed = secrets.randbelow(2**32)
    print(f"seed {seed}")
    try_all(2000, seed, BENCH, bench_file.load, drive, tmp_path / "bench.toml")
    try_all(2000, seed, CAMERA, camera_file.read, look, tmp_path / "camera.toml")
