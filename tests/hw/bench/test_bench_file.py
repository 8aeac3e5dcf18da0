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


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("baud = 9600\n", "baud is 9600; use 57600, 115200, 1000000"),
        ('board = "cards"\n', "board is 'cards'; use rings, tissue, several"),
        ("[handle.up_down]\nid = 2\n", "both handles have motor 2; give each its own id"),
        ("[handle.up_down]\nid = 1\ndirection = 0\n", "direction is 0; use 1 or -1"),
        ("[handle.up_down]\nid = 1\nrange_rad = [1, -1]\n", "give the lower end first"),
        ("[handle.up_down]\nid = 1\nratio = 2.0\n", r"handle.up_down may turn its motor by 6.00"),
        ("[handle.up_down]\nid = 1\ncurrent_limit_a = 100\n", "less than or equal to 3.2"),
        ("[handle.up_down]\nid = 1\nzero_count = 3\n", "did you mean handle.up_down.zero_counts"),
        ("baud == 1\n", "is not TOML"),
    ],
)
def test_unusable_values_give_one_line(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        bench_file.load(write(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_a_run_needs_calibrated_zeros(tmp_path: Path) -> None:
    path = write(tmp_path, "[handle.up_down]\nid = 1\nzero_counts = 2048\n")
    with pytest.raises(ConfigError, match="lacks zero_counts of one or both handles") as caught:
        rigs.bench_of("serial:PORT", path)
    assert "endolock doctor --port PORT --set-up" in str(caught.value)
    with pytest.raises(ConfigError, match=r"^--bench goes with --rig serial:PORT, not with twin$"):
        rigs.bench_of("twin", path)
