"""Experiments from names and from objects, and what an interruption leaves."""

from __future__ import annotations

import pickle
import re
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from endolock import (
    ConfigError,
    DeviceFault,
    Experiment,
    Instrument,
    Interrupted,
    SurrogateRig,
    TruthEyes,
    TwinRig,
    load_instrument,
    load_scenario,
    read_run,
)
from endolock.control.laws.still import Still
from endolock.hw.api import Command, State
from endolock.scripts.runs import batch
from endolock.scripts.runs.run_folder import RunFolder
from endolock.scripts.runs.series import run_all
from endolock.twin.world.fitted_plays import plays_of
from endolock.vision.observation import Observation


def quick(folder: Path, **changes: object) -> Experiment:
    """Half a second without pictures."""
    plain = Experiment(scenario="straight", vision="truth", duration_s=0.5, out=folder)
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


@pytest.mark.parametrize(
    ("made", "changes", "why"),
    [
        ({"scenario": "circle"}, {}, "with another scenario; give scenario=rig.scenario"),
        ({"seed": 5}, {}, "with another seed; give seed=rig.seed"),
        ({"instrument": load_instrument("slack")}, {}, "with another instrument; give instrument="),
        ({}, {"vision": "marker"}, "vision 'marker' is unknown; use markers or track or truth"),
        ({}, {"vision": "markers"}, "the rig takes no pictures for markers; use vision truth"),
        ({}, {"select": (1, 2, 30, 30)}, "select goes with vision track, not with truth"),
        ({}, {"bench": "bench.toml"}, "a bench file goes with rig serial:PORT; leave bench out"),
    ],
)
def test_a_rig_that_does_not_fit_is_refused(
    made: dict[str, Any], changes: dict[str, Any], why: str, tmp_path: Path
) -> None:
    scenario = load_scenario(made.pop("scenario", "straight"), {"duration_s": 0.5})
    with SurrogateRig(scenario, **made) as rig:
        experiment = quick(tmp_path / "run", rig=rig, **changes)
        with pytest.raises(ConfigError, match=re.escape(why)):
            experiment.run()
    assert not (tmp_path / "run").exists()


def test_a_selection_is_the_target_of_a_rig_object_too(tmp_path: Path) -> None:
    scenario = load_scenario("straight", {"duration_s": 0.5})
    followed = {"scenario": scenario, "vision": "track", "select": (320, 240, 41, 41)}
    named = quick(tmp_path / "named", **followed).run()
    with TwinRig(scenario) as rig:
        rig.clock.sleep_until(0.0)
        own = quick(tmp_path / "own", rig=rig, **followed).run()
    assert own.error_px == named.error_px


def test_the_oracle_knows_the_instrument_of_a_rig_object(tmp_path: Path) -> None:
    with SurrogateRig("straight", instrument=load_instrument("slack")) as rig:
        experiment = quick(
            tmp_path / "run",
            scenario=rig.scenario,
            duration_s=None,
            rig=rig,
            instrument=rig.instrument,
            controller="oracle",
        )
        settings = experiment.resolve().settings
    assert settings.plays == plays_of(rig.instrument, rig.scenario.shaft_bend_deg)


def test_a_rig_that_is_further_on_has_no_hindsight(tmp_path: Path) -> None:
    scenario = load_scenario("straight", {"duration_s": 0.5})
    with SurrogateRig(scenario) as rig:
        rig.clock.sleep_until(0.0)
        records = [quick(tmp_path / n, scenario=scenario, rig=rig).run() for n in ("a", "b")]
    assert records[0].constant_px
    assert records[1].constant_px is None  # the path of those seconds is another
    assert records[1].needed_tip_deg is None


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"seed": -1}, "seed -1; use a whole number, 0 or more"),
        ({"seed": 1.5}, "seed 1.5; use a whole number"),
        ({"seed": None}, "seed None; use a whole number"),
        ({"seed": True}, "seed true; use a whole number"),
        ({"seed": 2**64}, "seed 18446744073709551616; use a whole number"),
        ({"duration_s": True}, "duration_s true; use a number of seconds"),
        ({"latency_s": 10**400}, "latency_s 1000000000"),
        ({"duration_s": "2"}, "duration_s '2'; use a number of seconds"),
        ({"vary": "law.ki=1"}, "vary 'law.ki=1'; use a tuple of texts"),
        ({"select": "1,2,30,30"}, "select '1,2,30,30'; use left, top, width and height"),
        ({"rig": None}, "None is not a rig; give a name or an object"),
        ({"rig": TwinRig}, "is not a rig; give a name or an object"),
    ],
)
def test_a_field_of_the_wrong_type_is_refused(
    changes: dict[str, Any], why: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=re.escape(why)):
        quick(tmp_path / "run", **changes)


def test_fields_are_taken_as_users_have_them(tmp_path: Path) -> None:
    changes = {"out": str(tmp_path / "run"), "seed": np.int64(3), "vary": []}
    record = quick(tmp_path, **changes).run()
    assert read_run(tmp_path / "run").record == record
    assert record.seed == 3


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
        text = re.sub('(# .*\n|  "crc32.*\n|,\n  "rows[^}]*})', "", file.read_text())  # no seals
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


class Failing(Still):
    """Stops with a fault after 0.1 s."""

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Hold, then fail."""
        if t > 0.1:
            raise DeviceFault("handle stopped", "free it", kind="following", t=t)
        return super().update(t, state, observation)


def test_a_fault_is_not_hidden_by_a_folder_that_cannot_be_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = RunFolder.close

    def close(self: RunFolder) -> None:
        whole(self)
        raise ConfigError("disk full", "make room")

    monkeypatch.setattr(RunFolder, "close", close)
    with pytest.raises(DeviceFault, match="handle stopped") as caught:
        quick(tmp_path / "run", controller=Failing).run()
    assert any("disk full" in note for note in caught.value.__notes__)


def test_an_interruption_survives_another_process(tmp_path: Path) -> None:
    with pytest.raises(Interrupted) as caught:
        quick(tmp_path / "run", controller=Interrupting).run()
    back = pickle.loads(pickle.dumps(caught.value))
    assert (str(back), back.record) == (str(caught.value), caught.value.record)
    with pytest.raises(KeyboardInterrupt):
        batch.perform([quick(tmp_path, controller=Interrupting)])


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
