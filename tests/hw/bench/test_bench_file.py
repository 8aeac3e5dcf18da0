"""The file of a bench: what it may say, and what is said of what it may not."""

from __future__ import annotations

from pathlib import Path

import pytest

from endolock.hw.api import ConfigError
from endolock.hw.bench import bench_file
from endolock.scripts.runs import rigs


def write(place: Path, text: str) -> Path:
    """Write a bench file."""
    path = place / "bench.toml"
    path.write_text(text)
    return path


def test_a_bench_file_is_read_back(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        'board = "tissue"\n[handle.up_down]\nid = 4\ndirection = -1\nzero_counts = 2071\n'
        "ratio = 1.5\nrange_rad = [-1.0, 1.5]\ncurrent_limit_a = 0.3\n"
        '[camera]\nsource = "/dev/video2"\nlatency_s = 0.38\n',
    )
    found = bench_file.load(path)
    assert found.handles["up_down"].zero_counts == 2071
    assert found.handles["left_right"].id == 2  # a default
    bench_file.save(found, path)
    assert bench_file.load(path) == found


def test_the_camera_file_is_looked_for_beside_the_bench_file(tmp_path: Path) -> None:
    path = write(tmp_path, '[camera]\ncalibration = "camera.toml"\n')
    assert bench_file.load(path).camera.calibration == tmp_path / "camera.toml"


def _up_down(line: str) -> str:
    return f"[handle.up_down]\nid = 1\n{line}\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("baud = 9600\n", "baud is 9600; use 57600, 115200, 1000000"),
        ('board = "cards"\n', "board is 'cards'; use rings, tissue, several"),
        ("[handle.up_down]\nid = 2\n", "both handles have motor 2; give each its own id"),
        ("[handle.up_down]\nid = 1\ndirection = 0\n", "direction is 0; use 1 or -1"),
        ("[handle.up_down]\nid = 1\nrange_rad = [1, -1]\n", "give the lower end first"),
        ("[handle.up_down]\nid = 1\nratio = 2.0\n", r"handle.up_down may turn its motor by 6.00"),
        (_up_down("current_limit_a = 300"), "got 300 A, wanted 0.02 to 5.5 A; give amperes, not"),
        (
            _up_down("range_rad = [-90, 90]"),
            r"range_rad.0: got -90 rad, wanted -6.28.* not degrees",
        ),
        (_up_down("range_rad = [0.5, 1.0]"), r"\[0.5, 1\] without 0, at which zero_counts are"),
        (_up_down("range_rad = [0, 1e-300]"), "less than 0.01 rad; give a wider one"),
        (_up_down("range_rad = [nan, 1]"), "range_rad.0: should be a finite number, got nan"),
        (_up_down("range_rad = 1.0"), r"should be a valid tuple, got 1.0; give an array"),
        (_up_down("speed_rad_s = inf"), "speed_rad_s: should be a finite number, got inf"),
        (_up_down("speed_rad_s = 100.0"), "got 100 rad/s, wanted 0.01 to 20 rad/s; give radians"),
        (_up_down("ratio = 1e-300"), "ratio: got 1e-300, wanted 0.01 to 100; give a number in"),
        (_up_down("zero_counts = 2048.0"), "zero_counts: should be a valid integer, got 2048.0"),
        (_up_down("zero_counts = 400000"), "got 400000 counts, wanted -40960 to 40960 counts; let"),
        (_up_down("direction = -1.0"), "direction: should be a valid integer, got -1.0"),
        ("[handle.up_down]\nid = true\n", "handle.up_down.id: should be a valid integer, got true"),
        ("[handle.up_down]\nid = 253\n", "got 253, wanted 0 to 252"),
        (
            'baud = "1000000"\n',
            "baud: should be a valid integer, got '1000000'; give a whole number",
        ),
        ("[camera]\nlatency_s = 380\n", "got 380 s, wanted 0 to 10 s; give seconds, not milli"),
        ("[camera]\nlatency_s = inf\n", "latency_s: should be a finite number, got inf"),
        ("[camera]\nsource = true\n", "camera.source: got true; give the number"),
        ("[camera]\nsource = -1\n", "camera.source: got -1; give the number"),
        ("[camera]\nsource = 1.0\n", "camera.source: got 1.0; give the number"),
        ('[camera]\nsource = ""\n', "camera.source: got ''; give the number"),
        ('[camera]\nsource = "a\\u0000"\n', "camera.source: got 'a.x00'; give the number"),
        ("[camera]\ncalibration = 3\n", "camera.calibration: got 3; give a file in quotes"),
        ('[camera]\ncalibration = ""\n', "camera.calibration: got ''; give a file in quotes"),
        ("[camera]\nframe_rate_hz = 0\n", "got 0 Hz, wanted 0.1 to 1000 Hz"),
        ("[camera]\nvideo_timeout_s = 1\n", "got 1 s, wanted 2 to 600 s"),
        ("[[camera]]\nsource = 0\n", r"there is only one; write \[camera\]"),
        ("camera = 3\n", "camera: "),
        (f"baud = {'9' * 5000}\n", "is not TOML"),
        (f"x = {'[' * 5000}\n", "is not TOML"),
        ("[handle.up_down]\nid = 1\nzero_count = 3\n", "did you mean handle.up_down.zero_counts"),
        ("baud == 1\n", "is not TOML"),
    ],
)
def test_unusable_values_give_one_line(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        bench_file.load(write(tmp_path, text))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_a_run_needs_calibrated_zeros(tmp_path: Path) -> None:
    path = write(tmp_path, "[handle.up_down]\nid = 1\nzero_counts = 2048\n")
    with pytest.raises(ConfigError, match="lacks zero_counts of one or both handles") as caught:
        rigs.bench_of("serial:PORT", path)
    assert "endolock doctor --port PORT --set-up" in str(caught.value)
    with pytest.raises(ConfigError, match=r"^--bench goes with --rig serial:PORT, not with twin$"):
        rigs.bench_of("twin", path)
