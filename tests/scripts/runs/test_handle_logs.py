"""Logs of handle angles and tip bends: what a wrong one is refused with."""

from pathlib import Path

import pytest

from endolock.hw.api import ConfigError
from endolock.scripts.runs import handle_logs


def test_what_is_wrong_with_a_log_and_what_to_do_stay_apart(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    columns = (handle_logs.TIME, *handle_logs.HANDLES, *handle_logs.BENDS)
    file.write_text(",".join(columns) + "\n0,0,0,0,0\n")
    with pytest.raises(ConfigError) as caught:
        handle_logs.read(file)
    assert caught.value.what == f"{file}: 1 rows"
    assert caught.value.next_step == "record several periods of a slow triangle wave"


COLUMNS = [handle_logs.TIME, *handle_logs.HANDLES, *handle_logs.BENDS]


@pytest.mark.parametrize(
    ("head", "row", "message"),
    [
        ([*COLUMNS, "t_s"], "0,0,0,0,0,0", "has column t_s more than once; leave one of them"),
        ([*COLUMNS, " tip_up_down_rad"], "0,0,0,0,0,0", "has column tip_up_down_rad more than"),
        (COLUMNS, "0,0,0,0,0,7", "line 2: 6 values under 5 columns; separate the values by"),
        (COLUMNS, "0,5,1,2,1,2", "line 2: 6 values under 5 columns"),
        (COLUMNS, "0,0,0,0", "line 2: tip_left_right_rad is ''; use a finite number"),
        (COLUMNS, "0,0,0,\x1b[2J,0", r"tip_up_down_rad is '\\x1b\[2J'; use a finite number"),
        ([*COLUMNS[:-1], "a\x07"], "0,0,0,0,0", "has no column tip_left_right_rad"),
    ],
)
def test_a_wrong_table_is_refused_in_one_line(
    tmp_path: Path, head: list[str], row: str, message: str
) -> None:
    file = tmp_path / "log.csv"
    file.write_text(f"{','.join(head)}\n{row}\n")
    with pytest.raises(ConfigError, match=message) as caught:
        handle_logs.read(file)
    assert str(caught.value).isprintable()


def _strokes() -> list[list[str]]:
    """A log that can be fitted: a slow triangle, and bends that follow it."""
    angles = [abs((0.02 * n) % 4 - 2) - 1 for n in range(800)]
    return [[str(0.1 * n), str(a), "0", str(0.8 * a), "0"] for n, a in enumerate(angles)]


def test_other_columns_may_hold_anything(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    rows = [COLUMNS + ["note", "note"], *([*row, "no number", ""] for row in _strokes())]
    file.write_text("".join(",".join(row) + ",\n" for row in rows))
    log = handle_logs.read(file)
    assert log.handle.shape == log.bend.shape == (800, 2)
    assert log.tension is None


def test_tensions_in_other_units_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    rows = [[*COLUMNS, *handle_logs.TENSIONS], *([*row, *4 * ["15000"]] for row in _strokes())]
    file.write_text("".join(",".join(row) + "\n" for row in rows))
    with pytest.raises(ConfigError, match=r"tensions reach 1\.5e\+04 N, wanted 0 to 5000 N; give"):
        handle_logs.read(file)
