"""`endolock compare` and `endolock run --dry-run`: rows, figure, sources, and what is refused."""

import json
from pathlib import Path

import cv2
import pytest

from endolock.scripts import cli
from endolock.scripts.commands import dry_run
from endolock.scripts.runs.experiment import Experiment

QUICK = ["compare", "--vision", "truth", "--duration-s", "1.5"]


def test_every_controller_runs_on_every_scenario_seed_and_latency(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "all"
    args = [*QUICK, "--scenarios", "straight", "rest", "--controllers", "pi", "ik"]
    args += ["--seeds", "2", "--latencies", "0.1", "0.2", "--out", str(out), "--json", "-"]
    assert cli.main(args) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    cases = [(r["scenario"], r["controller"], r["latency_s"], r["seed"]) for r in rows]
    assert len(set(cases)) == len(rows) == 2 * 2 * 2 * 2
    assert len([folder for folder in out.iterdir() if (folder / "metrics.json").exists()]) == 16
    picture = cv2.imread(str(out / "errors.png"))
    assert picture is not None
    assert picture.std() > 10  # something is drawn


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--controllers", "pi", "pid"], "controller 'pid' is unknown; use ik, ik_sync, oracle"),
        (["--scenarios", "rest", "roast"], "scenario 'roast' is unknown; use breathing"),
        (["--latencies", "0.1", "-0.1"], "camera.latency_s: got -0.1 s, wanted 0 to 5 s"),
        (["--seeds", "0"], "seeds 0; use 1 or more"),
        (
            ["--controllers", "pi", "pi"],
            "two runs have the folder ",
        ),
        (["--controllers"], "no controllers given; name at least one after --controllers"),
        (["--out", "."], ". is not an empty folder; give a new one with --out"),
    ],
)
def test_all_is_checked_before_the_first_run(
    args: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "mine.txt").write_text("precious")
    monkeypatch.chdir(tmp_path)
    assert cli.main([*QUICK, *args]) == 2
    said = capsys.readouterr()
    assert message in said.err
    assert said.err.count("\n") == 1
    assert [file.name for file in tmp_path.iterdir()] == ["mine.txt"]


def test_a_dry_run_lists_the_source_of_each_value(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    args = ["run", "straight", "--latency-s", "0.25", "--seed", "3", "--dry-run", "--json", "-"]
    assert cli.main(args) == 0
    values = json.loads(capsys.readouterr().out)
    assert values["scenario.camera.latency_s"] == {"value": 0.25, "source": "option"}
    assert values["scenario.motion.0.travel_m"] == {"value": 0.13, "source": "file"}
    assert values["scenario.camera.jitter_s"] == {"value": 0.0, "source": "default"}
    assert values["run.seed"] == {"value": 3, "source": "option"}
    assert values["run.controller"] == {"value": "pi", "source": "default"}
    assert values["instrument.conduit_friction"] == {"value": 0.16, "source": "default"}
    assert list(tmp_path.iterdir()) == []


def test_a_dry_run_checks_the_experiment(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["run", "straight", "--duration-s", "-1", "--dry-run"]) == 2
    assert "duration_s: got -1 s, wanted 0.02 to 86400 s" in capsys.readouterr().err


def test_a_dry_run_prints_the_configuration_of_the_run_folder(tmp_path: Path) -> None:
    request = Experiment(scenario="circle", vision="truth", duration_s=0.1, out=tmp_path / "r")
    values = dry_run.resolved(request)
    assert values["scenario.duration_s"] == (0.1, "option")
    folder = request.run().folder
    text = (folder / "run.toml").read_text()
    for key in ("scenario.shaft_bend_deg", "instrument.slack_m", "numerics.hinges"):
        name = key.rsplit(".", 1)[1]
        assert f"{name} = {values[key][0]}" in text
