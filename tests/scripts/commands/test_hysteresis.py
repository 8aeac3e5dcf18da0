"""`endolock hysteresis`: figures of the default instrument, files, bad input, interruption."""

import json
import re
import signal
from pathlib import Path
from typing import Any

import cv2
import mujoco
import pytest

from endolock.hw.api import Pose
from endolock.scripts import cli
from endolock.scripts.runs import hysteresis_widths, run_folder
from endolock.scripts.runs.hysteresis_measurement import HysteresisMeasurement
from endolock.twin.pose_tracker import TwinPoseTracker


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a whole measurement of the default instrument, with what --json wrote."""
    out = tmp_path_factory.mktemp("hysteresis") / "run"
    args = ["hysteresis", "--out", str(out), "--json", str(out.parent / "record.json")]
    assert cli.main(args) == 0
    return out


def _loop(shaft_deg: float) -> dict[str, Any]:
    """Figures of the loop alone, without the one-sided strokes and the drift."""
    measurement = HysteresisMeasurement(numerics="fast", shaft_deg=shaft_deg)
    return hysteresis_widths.figures(measurement.strokes(whole=False).strokes)


def test_the_width_is_the_calibrated_one_and_grows_with_the_shaft(folder: Path) -> None:
    half = json.loads((folder / "hysteresis.json").read_text())
    straight, whole = (_loop(shaft_deg) for shaft_deg in (0.0, 360.0))
    assert 0.18 <= half["width"]["30"] <= 0.22  # w = 0.2 has one digit in the excerpt
    assert straight["width"]["30"] < half["width"]["30"] < whole["width"]["30"]
    assert half["deadband_rad"] == 0.0
    assert half["drift_deg_per_min"] < 0.5  # creep of the soft friction rows
    assert half["max_bend_deg"] > 90
    # reported by the thesis: more motion is lost at a far turn than at one near the centre
    for side in ("positive", "negative"):
        turns = half["strokes"][side]
        assert turns["back"]["90"] > turns["back"]["30"] > turns["out"]["30"]
        # a full turn at a bend loses the loop's width there; 3 %: measured from 8 deg on
        assert turns["back"]["60"] == pytest.approx(half["width"]["60"], rel=0.03)


def test_a_folder_holds_log_figures_and_picture(folder: Path) -> None:
    record = json.loads((folder.parent / "record.json").read_text())
    assert record == json.loads((folder / "hysteresis.json").read_text())
    ticks = run_folder.read(folder, "ticks").to_pylist()
    assert sum(row["tracked_pose"] is not None for row in ticks) > 0.99 * len(ticks)
    assert all(
        row["bend_rad"] is None for row in ticks
    )  # a log contains only what a bench can measure
    handles = [row["position_rad"][0] for row in ticks]
    assert max(handles) == pytest.approx(record["crest_rad"], abs=0.02)  # servo lag, 2 ticks
    configuration = run_folder.configuration(folder)
    assert configuration["scenario"]["shaft_bend_deg"] == 180.0
    assert configuration["versions"]["mujoco"] == mujoco.__version__
    picture = cv2.imread(str(folder / "hysteresis.png"))
    assert picture is not None
    assert picture.shape[1] > 1000


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--axis", "roll"], "axis"),
        (["--other-axis-deg", "170"], "left_right bends to 1.. deg at most, not to 170; use a sm"),
        (["--other-axis-deg", "nan"], "--other-axis-deg nan; use a number of degrees, such as 60"),
        (["--shaft-deg", "2000"], "shaft_bend_deg: got 2000 deg, wanted -1080 to 1080 deg"),
        (["--instrument", "oboe"], "instrument 'oboe' is unknown"),
        (["--rig", "car"], "rig 'car' is unknown; use twin"),
        (["--noise-deg", "-1"], "tracker.rotation_noise_deg: got -1 deg, wanted 0 to 30 deg"),
    ],
)
def test_bad_input_gives_one_line_and_leaves_nothing(
    args: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert cli.main(["hysteresis", *args, "--out", str(out)]) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("endolock:")]
    assert len(said) == 1
    assert re.search(message, said[0])
    assert not out.exists()


def test_a_blind_tracker_leaves_no_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def blind(_tracker: TwinPoseTracker) -> Pose | None:
        return None

    monkeypatch.setattr(TwinPoseTracker, "latest", blind)
    assert cli.main(["hysteresis", "--out", str(tmp_path / "run")]) == 2
    assert "the pose tracker gave 0 poses in 1.0 s; check that" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_ctrl_c_ends_with_130_and_a_readable_log(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    measure, seen = TwinPoseTracker.measure, []

    def interrupt(tracker: TwinPoseTracker) -> None:
        measure(tracker)
        seen.append(1)
        if len(seen) == 500:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(TwinPoseTracker, "measure", interrupt)
    out = tmp_path / "run"
    assert cli.main(["hysteresis", "--out", str(out)]) == 130
    assert run_folder.read(out, "ticks").num_rows > 100
    assert not (out / "hysteresis.json").exists()


def test_strokes_that_depend_on_the_time_step_say_so() -> None:
    fast = HysteresisMeasurement(instrument="slack", numerics="fast")
    (note,) = fast.notes
    assert note.startswith("results depend on the time step: ")
    assert fast.timestep_error_deg is not None
    assert fast.timestep_error_deg > 0.5
    assert HysteresisMeasurement(instrument="slack").notes == ()
