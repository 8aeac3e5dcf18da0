"""Experiments from names and from objects, and what an interruption leaves."""

from __future__ import annotations

import signal
from dataclasses import replace
from pathlib import Path

import pytest

from endolock import (
    ConfigError,
    Experiment,
    Instrument,
    Interrupted,
    TruthEyes,
    TwinRig,
    load_scenario,
    read_run,
)
from endolock.control.laws.still import Still
from endolock.hw.api import Command, State
from endolock.scripts.runs.series import run_all
from endolock.vision.observation import Observation


def quick(out: Path, **changes: object) -> Experiment:
    """Half a second without pictures."""
    plain = Experiment(scenario="straight", vision="truth", duration_s=0.5, out=out)
    return replace(plain, **changes)  # type: ignore[arg-type]  # fields by name


def test_objects_give_the_same_run_as_their_names(tmp_path: Path) -> None:
    named = quick(tmp_path / "named", seed=3).run()
    scenario = load_scenario("straight", {"duration_s": 0.5})
    made = quick(tmp_path / "made", scenario=scenario, instrument=Instrument(), seed=3).run()
    with TwinRig(scenario, seed=3, pictures=False) as rig:
        rig.clock.sleep_until(0.0)
        own = quick(
            tmp_path / "own", scenario=scenario, rig=rig, vision=TruthEyes(rig.truth), seed=3
        ).run()
        assert rig.clock.now() >= 0.5  # it is still there
    first = read_run(named.folder).ticks
    for record in (made, own):
        assert read_run(record.folder).ticks.equals(first)
        assert record.error_px == named.error_px
        assert record.constant_px == named.constant_px
    assert (own.rig, own.vision, made.instrument) == ("TwinRig", "TruthEyes", "Instrument")


def test_a_rig_of_another_scenario_is_refused(tmp_path: Path) -> None:
    with TwinRig("circle", pictures=False) as rig:
        experiment = quick(tmp_path / "run", rig=rig)
        with pytest.raises(ConfigError, match=r"give scenario=rig\.scenario"):
            experiment.run()


def test_eyes_without_their_rig_are_refused(tmp_path: Path) -> None:
    with TwinRig("straight", pictures=False) as rig:
        experiment = quick(tmp_path / "run", vision=TruthEyes(rig.truth))
    with pytest.raises(
        ConfigError, match="an eyes object needs the rig it was made for; give that rig too"
    ):
        experiment.resolve()


def test_the_record_is_read_back_as_it_was(tmp_path: Path) -> None:
    record = quick(tmp_path / "run").run()
    back = read_run(tmp_path / "run")
    assert back.record == record
    assert back.configuration["run"]["controller"] == "pi"
    assert back.frames.num_rows == record.frames
    (tmp_path / "run" / "metrics.json").unlink()
    assert read_run(tmp_path / "run").record is None


def test_a_folder_of_another_version_is_refused_by_that_version(tmp_path: Path) -> None:
    quick(tmp_path / "run").run()
    for name, cut in (("run.toml", '= "0.1.0"'), ("metrics.json", '"seed": 0,')):
        file = tmp_path / "run" / name
        text = file.read_text()
        assert cut in text
        file.write_text(text.replace(cut, '= "0.0.7"' if name == "run.toml" else ""))
    with pytest.raises(ConfigError, match=r"written by endolock 0.0.7 .*seed.*; read it with that"):
        read_run(tmp_path / "run")


class Interrupting(Still):
    """Sends the process a signal after 0.2 s."""

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Hold, and interrupt once."""
        if abs(t - 0.2) < 1e-6:
            signal.raise_signal(signal.SIGINT)
        return super().update(t, state, observation)


def test_an_interruption_is_one_exception_with_a_complete_record(tmp_path: Path) -> None:
    experiments = [
        quick(tmp_path / "first"),
        quick(tmp_path / "second", controller=Interrupting),
        quick(tmp_path / "third"),
    ]
    with pytest.raises(Interrupted, match=r"after 0\.2 s") as caught:
        replace(experiments[1], out=tmp_path / "alone").run()
    assert caught.value.record.interrupted
    assert read_run(tmp_path / "alone").record == caught.value.record
    series = run_all(experiments, show_progress=False)
    assert [record.interrupted for record in series.records] == [False, True]
    assert not (tmp_path / "third").exists()
    with pytest.raises(Interrupted, match=r"in run 2 of 3, after 0\.2 s"):
        series.conclude()
