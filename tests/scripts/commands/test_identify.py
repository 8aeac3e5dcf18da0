"""`endolock identify`: from run folders and CSV files to an instrument, and what it refuses."""

import csv
import json
from collections.abc import Callable
from math import degrees, pi
from pathlib import Path

import numpy as np
import pytest

from endolock.control.transmission.quasi_static import Cable, Geometry
from endolock.control.transmission.simulation import simulate
from endolock.hw.api import Vector
from endolock.scripts import cli
from endolock.scripts.runs import handle_logs
from endolock.twin.world import instrument_files

MADE = Cable(conduit_exponent=0.6, section_friction=0.18, stiffness=9e4, slack_m=-3e-3, sheath=0.08)
COLUMNS = (handle_logs.TIME, *handle_logs.HANDLES, *handle_logs.BENDS)
Rows = dict[str, Vector]


def _rows(periods: float = 2.0, peak: float = 2.3) -> Rows:
    """A triangle wave at 0.2 rad/s behind the model itself, which is all these tests need."""
    end = periods * 4 * peak / 0.2
    t = np.arange(0.0, end, 0.1)
    phase = (0.2 * t / peak + 1) % 4
    handle = peak * (1 - np.abs(phase - 2))
    nothing = np.zeros(len(t))
    bend, _ = simulate(MADE, Geometry(), handle, nothing, nothing)
    bend = bend + 1e-3 * np.random.default_rng(0).standard_normal(len(t))
    return dict(zip(COLUMNS, (t, handle, nothing, bend, nothing), strict=True))


def _write(rows: Rows, path: Path) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(rows)
        writer.writerows(zip(*rows.values(), strict=True))
    return path


def test_a_csv_file_becomes_an_instrument(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = _write(_rows(), tmp_path / "bench.csv")
    assert cli.main(["identify", str(log), "--json", "-"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["params"]["mu_wrap"]["determined"]
    assert record["params"]["mu_wrap"]["value"] == pytest.approx(0.6, rel=0.05)  # noise of 0.06 deg
    assert record["heldout_rms_deg"] == pytest.approx(degrees(1e-3), rel=0.3)
    found = instrument_files.load(tmp_path / "bench-instrument.toml")
    assert found.wire_stiffness == pytest.approx(9e4 * found.bending_stiffness, rel=0.05)
    assert found.slack_m == pytest.approx(-3e-3, rel=0.05)
    assert found.conduit_friction * found.wrap_at(pi) == pytest.approx(0.6, rel=0.05)
    # again: its own file may be written over
    assert cli.main(["identify", str(log)]) == 0
    assert "not determined" in capsys.readouterr().out  # slack, with wires under tension


def test_a_run_folder_becomes_an_instrument_that_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "log"
    common = ["hysteresis", "--numerics", "fast", "--json", str(tmp_path / "h.json")]
    assert cli.main([*common, "--instrument", "slack", "--out", str(out)]) == 0
    before = json.loads((tmp_path / "h.json").read_text())
    assert cli.main(["identify", str(out), "--hinges", "10"]) == 0
    fitted = str(out / "instrument.toml")
    assert cli.main([*common, "--instrument", fitted]) == 0
    after = json.loads((tmp_path / "h.json").read_text())
    for bend in ("0", "30", "60"):
        # K is assumed and drops out of every angle; 3 %: parameters are known to 1-2 %
        assert after["width"][bend] == pytest.approx(before["width"][bend], rel=0.03)
    assert after["deadband_rad"] == pytest.approx(before["deadband_rad"], rel=0.03)
    run = ["run", "rest", "--vision", "truth", "--duration-s", "0.2", "--out", str(tmp_path / "r")]
    assert cli.main([*run, "--instrument", fitted]) == 0
    capsys.readouterr()


def _degrees(rows: Rows) -> Rows:
    return rows | {name: np.degrees(rows[name]) for name in COLUMNS[1:]}


def _gap(rows: Rows) -> Rows:
    kept = (rows["t_s"] < 30) | (rows["t_s"] > 34)
    return {name: column[kept] for name, column in rows.items()}


def _backwards(rows: Rows) -> Rows:
    return rows | {"t_s": rows["t_s"][::-1]}


def _one_way(rows: Rows) -> Rows:
    return {name: column[:100] for name, column in rows.items()}


def _renamed(rows: Rows) -> Rows:
    return {name.replace("tip_up_down_rad", "tip_updown_rad"): rows[name] for name in rows}


def _hole(rows: Rows) -> Rows:
    rows["tip_up_down_rad"][7] = np.nan
    return rows


def _pushing(rows: Rows) -> Rows:
    wires = {name: np.linspace(-5.0, 5.0, len(rows["t_s"])) for name in handle_logs.TENSIONS}
    return rows | wires


def _without_load(rows: Rows) -> Rows:
    return rows | dict.fromkeys(handle_logs.TENSIONS, np.zeros(len(rows["t_s"])))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (_degrees, "handle angles reach 131.8, more than 12.6 rad: these look like degrees"),
        (_gap, "a gap of 4.20 s after t = 29.9 s"),
        (_backwards, "time does not increase after t = "),
        (_one_way, "the handle reverses 0 times; record 3 reversals or more"),
        (_renamed, "has no column tip_up_down_rad; is tip_updown_rad meant?"),
        (_hole, "line 9: tip_up_down_rad is 'nan'; use a finite number"),
        (_pushing, "tensions are negative, but wires can only pull"),
        (_without_load, "the tensions of the up_down wires are all zero"),
        (
            lambda rows: rows | {"tip_up_down_rad": -rows["tip_up_down_rad"]},
            "the up_down bend does not follow its handle (correlation -0.9",
        ),
        (lambda rows: {k: v[:1] for k, v in rows.items()}, "1 rows; record several periods"),
        (
            lambda rows: rows | {"handle_up_down_rad": 0.1 * rows["handle_up_down_rad"]},
            "the handle moves by 26.4 deg from peak to peak; record strokes of at least 17 deg",
        ),
        (
            lambda rows: rows | {"tip_up_down_rad": 0.01 * rows["tip_up_down_rad"]},
            "the tip moves by",
        ),
        (
            lambda rows: rows | {"tension_up_n": rows["t_s"]},
            "has tension_up_n; give all four tensions, or none",
        ),
    ],
)
def test_a_bad_log_gives_one_line_and_no_file(
    spoil: Callable[[Rows], Rows],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    log = _write(spoil(_rows()), tmp_path / "bench.csv")
    assert cli.main(["identify", str(log)]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert message in said[-1]
    assert sum(line.startswith("endolock:") for line in said) == 1
    assert list(tmp_path.iterdir()) == [log]


@pytest.mark.parametrize(
    ("text", "args", "message"),
    [
        (None, [], "no log at"),
        ("", [], "is empty; give a CSV file with a header"),
        ("\x00\x01", [], "has no column t_s"),
        ("\n\n", [], "starts with an empty line; give a CSV file with a header"),
        ("t_s", ["--base", "oboe"], "instrument 'oboe' is unknown"),
        ("t_s", ["--hinges", "7"], "use lengths above 0 and an even number of hinges"),
    ],
)
def test_other_bad_input_gives_one_line(
    text: str | None,
    args: list[str],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    log = tmp_path / "bench.csv"
    if text is not None:
        log.write_text(text)
    assert cli.main(["identify", str(log), *args]) == 2
    assert message in capsys.readouterr().err


def test_other_files_are_not_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = _write(_rows(), tmp_path / "bench.csv")
    precious = tmp_path / "mine.toml"
    precious.write_text("slack_m = 0.001\n")
    (tmp_path / "folder.toml").mkdir()
    for target, message in (
        (
            tmp_path / "folder.toml",
            "exists and was not written by endolock identify; give another --out",
        ),
        (precious, "exists and was not written by endolock identify; give another --out"),
        (tmp_path / "nowhere" / "x.toml", "there is no folder"),
        (tmp_path / "x.txt", "does not end in .toml; give a file name that ends in .toml"),
    ):
        assert cli.main(["identify", str(log), "--out", str(target)]) == 2
        assert message in capsys.readouterr().err
    assert precious.read_text() == "slack_m = 0.001\n"


@pytest.mark.parametrize("shaft", ["nan", "1e9"])
def test_an_impossible_shaft_is_refused(
    shaft: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = _write(_rows(), tmp_path / "bench.csv")
    assert cli.main(["identify", str(log), "--shaft-deg", shaft]) == 2
    assert "is out of range; use 1080 at most" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [log]


def test_a_folder_without_a_tracker_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    run = ["run", "rest", "--vision", "truth", "--duration-s", "0.1", "--out", str(out)]
    assert cli.main(run) == 0
    capsys.readouterr()
    assert cli.main(["identify", str(out)]) == 2
    assert "has no poses from a tracker; record some with endolock hysteresis --out DIR" in (
        capsys.readouterr().err
    )
