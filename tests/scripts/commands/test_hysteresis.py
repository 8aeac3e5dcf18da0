"""`endolock hysteresis`: figures of the instruments, files, bad input, interruption."""

import json
import re
import signal
from math import degrees
from pathlib import Path
from typing import Any

import cv2
import mujoco
import pytest

from endolock.hw.api import ConfigError, Mode, Pose
from endolock.scripts import cli
from endolock.scripts.commands import hysteresis
from endolock.scripts.commands.hysteresis import Request
from endolock.scripts.runs import hysteresis_protocol, run_folder
from endolock.scripts.runs.hysteresis_protocol import Protocol
from endolock.twin.pose_tracker import TwinPoseTracker
from endolock.twin.rig import TwinRig
from endolock.twin.world import instrument_files


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a whole measurement of the default instrument, with what --json wrote."""
    out = tmp_path_factory.mktemp("hysteresis") / "run"
    args = ["hysteresis", "--out", str(out), "--json", str(out.parent / "told.json")]
    assert cli.main(args) == 0
    return out


def _loop(**options: Any) -> dict[str, Any]:
    """Figures of the loop alone, without the one-sided strokes and the drift."""
    request = Request(numerics="fast", **options)
    strokes, other_axis_rad, _ = hysteresis._strokes(request, False, whole=False)
    return hysteresis.figures(strokes) | {"other_axis_deg": degrees(other_axis_rad)}


def test_the_width_is_the_calibrated_one_and_grows_with_the_shaft(folder: Path) -> None:
    half = json.loads((folder / "hysteresis.json").read_text())
    straight, whole = (_loop(shaft_deg=deg) for deg in (0.0, 360.0))
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


@pytest.mark.parametrize("axis", ["up_down", "left_right"])
def test_the_other_axis_widens_the_loop(axis: Any) -> None:
    alone, beside = (_loop(axis=axis, other_axis_deg=deg) for deg in (0.0, 60.0))
    assert beside["other_axis_deg"] == pytest.approx(60, abs=2)  # reached by turning slowly
    assert beside["width"]["30"] > 1.15 * alone["width"]["30"]


def test_slack_gives_a_deadband_and_friction_gives_none() -> None:
    slack = instrument_files.load("slack")
    right = pytest.approx(2 * slack.slack_m / slack.pulley_radius_m, rel=0.1)
    assert _loop(instrument="slack")["deadband_rad"] == right
    assert _loop(instrument="two_region", shaft_deg=0.0)["deadband_rad"] == right
    assert _loop(instrument="two_region")["deadband_rad"] == 0.0


def test_a_bend_that_remains_at_handle_zero_hides_the_smaller_strokes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(hysteresis_protocol, "DRIFT_S", 1.0)  # not checked here
    request = Request(shaft_deg=540.0, numerics="fast")
    record = hysteresis.perform(request, show_progress=False)
    assert record["width"]["30"] > 0.3  # the loop is still reported
    for ways in record["strokes"].values():
        assert ways["back"]["30"] is None
        assert ways["out"]["30"] is None


def test_half_the_speed_changes_no_width(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = _loop()["width"]
    monkeypatch.setattr(hysteresis_protocol, "SPEED_RAD_S", 0.1)
    slower = _loop()["width"]
    assert usual == pytest.approx(slower, rel=0.02)  # quasi-static; noise of the tracker is 0.5 %


def test_a_folder_holds_log_figures_and_picture(folder: Path) -> None:
    record = json.loads((folder.parent / "told.json").read_text())
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


def test_maps_are_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """With few points; a bend that the other axis cannot reach gives a row without figures."""
    monkeypatch.setattr(hysteresis, "MAP_OTHER_DEG", (0, 40, 170))
    monkeypatch.setattr(hysteresis, "MAP_SHAFT_DEG", (0, 180))
    monkeypatch.setattr(hysteresis_protocol, "DRIFT_S", 1.0)  # only the loops are looked at here
    monkeypatch.setattr(Protocol, "_one_sided", lambda *_: {})
    record = hysteresis.perform(Request(numerics="fast", map=True), show_progress=False)
    near, beside, beyond = record["map"]["width"]
    assert all(a < b for a, b in zip(near[:5], beside[:5], strict=True))
    assert set(beyond) == {None}
    record["shaft_map"]["deadband_rad"][0] = None  # as if a loop could not be measured
    straight, bent = record["shaft_map"]["width_at_30"]
    assert straight < bent
    from endolock.scripts.figures import hysteresis_figure

    assert hysteresis_figure.draw(record, tmp_path / "maps.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--axis", "roll"], "axis"),
        (["--other-axis-deg", "170"], "left_right bends to 1.. deg at most, not to 170; use a sm"),
        (["--other-axis-deg", "nan"], "--other-axis-deg nan; use a number of degrees, such as 60"),
        (["--shaft-deg", "2000"], "shaft_bend_deg: should be less than or equal to 1080"),
        (["--instrument", "oboe"], "instrument 'oboe' is unknown"),
        (["--rig", "car"], "rig 'car' is unknown; use twin"),
        (["--noise-deg", "-1"], "tracker.rotation_noise_deg: should be greater than or equal to 0"),
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


def test_a_rig_without_a_tracker_is_refused() -> None:
    with TwinRig("rest", pictures=False) as rig, pytest.raises(ConfigError, match="no pose tracke"):
        Protocol(rig, 0)


def test_a_blind_tracker_leaves_no_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def blind(_tracker: TwinPoseTracker) -> Pose | None:
        return None

    monkeypatch.setattr(TwinPoseTracker, "latest", blind)
    assert cli.main(["hysteresis", "--out", str(tmp_path / "run")]) == 2
    assert "the pose tracker gave 0 poses in 1.0 s; check that" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def _bend_and_run(protocol: Protocol) -> None:
    protocol.bend_other_axis(0.3)
    protocol.run()


@pytest.mark.parametrize("after_s", [2.0, 6.0])
def test_an_interruption_leaves_the_handles_held(after_s: float) -> None:
    """While the other axis is being bent, and during the strokes."""

    def interrupt(t: float) -> None:
        if t >= after_s:
            raise KeyboardInterrupt

    watched = hysteresis.scenario_for(180.0, 0.05)
    with TwinRig(watched, pictures=False) as rig:
        protocol = Protocol(rig, 0, interrupt)
        with pytest.raises(KeyboardInterrupt):
            _bend_and_run(protocol)
        assert rig.actuators.mode is Mode.HOLDING


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
