"""Time stamps of recordings: what is read, and which rows are not believed."""

from pathlib import Path

import pytest

from endolock.hw.api import ConfigError
from endolock.hw.camera import time_stamps


@pytest.mark.parametrize(
    ("text", "stamps"),
    [
        ("t_available\n0.1\n0.2\n", [(0.1, 0.1), (0.2, 0.2)]),
        ("t_available,t_capture\n0.5,0.1\n", [(0.1, 0.5)]),
        ("\ufefft_capture,note\n1e9,a\n1000000000.04,b\n", [(1e9, 1e9), (1e9 + 0.04,) * 2]),
        ("t_capture,t_available\n-0.4,0\n0,0.4\n", [(-0.4, 0.0), (0.0, 0.4)]),
    ],
)
def test_time_stamps_are_read(text: str, stamps: list[tuple[float, float]], tmp_path: Path) -> None:
    path = tmp_path / "times.csv"
    path.write_text(text, encoding="utf-8")
    assert time_stamps.read(path) == stamps


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t_available\n0.0\nx\n", r"row 2 \(line 3\): t_available is 'x'; give a number in"),
        ("t_capture\n0.2\nnan\n", r"row 2 \(line 3\): t_capture is 'nan'; give a number"),
        ("t_capture,t_available\n0,0\n1\n", r"row 2 \(line 3\): t_available is None"),
        ("when\n0.0\n", "none of the columns t_capture, t_available; give seconds in one or"),
        ("t_capture;t_available\n0;0\n", "none of the columns t_capture, t_available"),
        ("", "none of the columns t_capture, t_available"),
        ("t_capture\n", "no row below its header"),
        ("t_capture,t_capture\n0,1\n", "the column t_capture twice; remove one"),
        ("t_capture\n0.2\n0.1\n", r"row 2 \(line 3\): t_capture is 0.1 s, before 0.2 s in the"),
        ("t_capture\n1\n2\n\n2\n", r"row 3 \(line 5\): t_capture is 2 s, the same as in the row"),
        ("t_capture,t_available\n0,1\n1,1\n", r"row 2 \(line 3\): t_available is 1 s, the same"),
        ("t_capture,t_available\n0.4,0\n0.8,0.4\n", r"row 1 \(line 2\): captured at 0.4 s, deliv"),
        ("t_capture,t_available\n0,400\n40,440\n", "wanted 0 to 10 s later; exchange the columns"),
        ("t_capture\n0\n40\n80\n", "40 s apart, wanted up to 10 s; give seconds, not milliseconds"),
    ],
)
def test_bad_time_stamps_give_one_line_with_their_row(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "times.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=said) as caught:
        time_stamps.read(path)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_no_text_gives_one_line(tmp_path: Path) -> None:
    path = tmp_path / "times.csv"
    path.write_bytes(b"\xff\xfe\x00\x00")
    for there in (path, tmp_path / "missing.csv", tmp_path):
        with pytest.raises(ConfigError, match=r"cannot read .*; give a CSV file"):
            time_stamps.read(there)
