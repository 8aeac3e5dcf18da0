"""`endolock run --dry-run`: each value with its true source, and what is said beside it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from endolock.scripts import cli
from endolock.scripts.commands import dry_run
from endolock.scripts.runs.experiment import Experiment

BENCH = """
[handle.up_down]
id = 1
zero_counts = 2048
[handle.left_right]
id = 2
zero_counts = 2048
[camera]
source = 2
{latency}
"""


def test_values_come_from_options_variations_files_and_the_scenario() -> None:
    found = dry_run.resolved(
        Experiment(
            scenario="straight",
            controller="repetitive",
            vision="truth",
            instrument="slack",
            duration_s=100.0,
            vary=(
                "camera.truth_noise_px=1",
                "jump",
                "instrument.rigid_tip_m=0.02",
                "numerics.timestep_s=0.001",
            ),
        )
    )
    assert found["law.period_s"] == (8.6, "scenario")
    assert found["scenario.duration_s"] == (100.0, "option")
    assert found["scenario.camera.truth_noise_px"] == (1, "vary")
    assert found["scenario.motion.1.travel_m"] == (0.02, "vary")
    assert found["scenario.board.distance_m"] == (0.12, "file")
    assert found["scenario.camera.latency_s"] == (0.4, "default")
    assert found["instrument.slack_m"] == (0.0005, "instrument")
    assert found["instrument.rigid_tip_m"] == (0.02, "vary")
    assert found["instrument.pulley_radius_m"] == (0.005, "default")
    assert found["numerics.timestep_s"] == (0.001, "vary")
    assert found["numerics.hinges"] == (12, "default")
    error_deg, source = found["numerics.timestep_error_deg"]
    assert 0 < error_deg < 0.5
    assert source == "measured"
    assert found["numerics.converging_timestep_s"] == (0.001, "measured")


def test_a_period_that_is_given_comes_from_there() -> None:
    vary = ("law.period_s=4", "motion=[]")
    experiment = Experiment(
        scenario="straight", controller="repetitive", rig="play", vision="truth", vary=vary
    )
    found = dry_run.resolved(experiment)
    assert found["law.period_s"] == (4, "vary")
    assert found["scenario.motion"] == ((), "vary")
    assert not any(key.startswith("numerics") for key in found)  # it has no steps to choose


def test_the_latency_of_a_bench_comes_from_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    bench = Experiment(scenario="straight", rig="serial:nowhere")
    Path("bench.toml").write_text(BENCH.format(latency="latency_s = 0.31"))
    found = dry_run.resolved(bench)
    assert found["scenario.camera.latency_s"] == (0.31, "bench")
    assert found["bench.camera.latency_s"] == (0.31, "bench")
    assert found["bench.camera.source"] == (2, "bench")
    assert found["bench.board"] == ("rings", "default")
    assert not any(key.startswith(("instrument", "numerics")) for key in found)
    option = Experiment(scenario="straight", rig="serial:nowhere", latency_s=0.2)
    assert dry_run.resolved(option)["scenario.camera.latency_s"] == (0.2, "option")
    Path("bench.toml").write_text(BENCH.format(latency=""))
    assert dry_run.resolved(bench)["scenario.camera.latency_s"] == (0.4, "default")


def test_results_that_depend_on_the_step_are_said_and_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    soft = ["--vary", "instrument.bending_stiffness=0.001", "--vision", "truth"]
    said = (
        "note: results depend on the time step: on a fixed drive, bends at 2 and 0.5 ms differ by"
    )
    assert cli.main(["run", "rest", *soft, "--dry-run", "--json", "-"]) == 0
    told = capsys.readouterr()
    assert told.err.count("\n") == 1
    assert said in told.err
    assert json.loads(told.out)["numerics.timestep_error_deg"]["value"] > 0.5
    out = tmp_path / "run"
    args = ["--duration-s", "0.2", "--out", str(out), "--json", "-"]
    assert cli.main(["run", "rest", *soft, *args]) == 0
    told = capsys.readouterr()
    assert said in told.err
    error_deg = json.loads(told.out)["timestep_error_deg"]
    assert error_deg > 0.5
    assert json.loads((out / "metrics.json").read_text())["timestep_error_deg"] == error_deg
    assert f"timestep_error_deg = {error_deg}" in (out / "run.toml").read_text()


def test_the_blur_of_a_run_is_that_of_its_exposure(tmp_path: Path) -> None:
    blur = []
    for n, exposure_s in enumerate((0.0, 0.01, 0.02)):
        record = Experiment(
            scenario="straight",
            rig="play",
            vision="truth",
            duration_s=2.0,
            vary=(f"camera.exposure_s={exposure_s}",),
            out=tmp_path / str(n),
        ).run()
        assert record.timestep_error_deg is None  # nothing is simulated in steps
        blur.append(record.blur_px)
    assert blur[0] == 0  # an ideal camera
    assert blur[1]
    assert blur[2] == pytest.approx(2 * blur[1])
