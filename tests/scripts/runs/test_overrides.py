"""Changes by KEY=VALUE and by file, and the messages for bad ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from endolock.hw.api import ConfigError
from endolock.scripts.runs import overrides
from endolock.scripts.runs.experiment import Experiment
from endolock.twin.world import scenario
from endolock.twin.world.instrument import Instrument

QUICK = ["--vision", "truth", "--duration-s", "2"]


def apply(*entries: str) -> overrides.Task:
    return overrides.apply("straight", "pretensioned", entries)


def test_a_key_with_its_value_changes_scenario_instrument_or_law() -> None:
    task = apply("camera.jitter_s=0.03", "instrument.conduit_friction=0.3", "law.form=play")
    assert task.scenario.camera.jitter_s == 0.03
    assert task.instrument == Instrument(conduit_friction=0.3)
    assert task.law == {"form": "play"}


def test_several_values_are_several_cases() -> None:
    assert overrides.expand("law.width=0.1,0.2") == ["law.width=0.1", "law.width=0.2"]
    assert overrides.expand("jump") == ["jump"]
    assert overrides.expand("motion=[{a=1, b=2}]") == ["motion=[{a=1, b=2}]"]


@pytest.mark.parametrize("name", overrides.names())
def test_every_disturbance_changes_something(name: str) -> None:
    task = apply(name)
    nominal = scenario.load("straight"), Instrument()
    assert (task.scenario, task.instrument) != nominal
    assert overrides.read(name).summary


def test_a_file_multiplies_instruments_and_adds_to_lists() -> None:
    gain, jump = apply("gain_more"), apply("jump", "breathing")
    assert gain.instrument.pulley_radius_m == pytest.approx(1.3 * Instrument().pulley_radius_m)
    kinds = [motion.kind for motion in jump.scenario.motion]
    assert kinds == ["strokes", "jump", "sine", "sine"]


def test_a_number_may_begin_with_its_point() -> None:
    assert apply("camera.latency_s=.25").scenario.camera.latency_s == 0.25


def test_a_scenario_may_become_possible_by_its_options(tmp_path: Path) -> None:
    """A file that is scored from 30 s on, and lasts 25 s unless an option says 40."""
    file = tmp_path / "late.toml"
    file.write_text("scored_from_s = 30")
    with pytest.raises(ConfigError, match="scored_from_s 30 is not before the end at 25 s"):
        overrides.apply(file, "pretensioned", ("jump",))
    made = overrides.apply(file, "pretensioned", ("jump",), {"duration_s": 40.0})
    assert made.scenario.scored_from_s == 30


def test_a_list_given_by_key_replaces() -> None:
    task = apply("motion=[{kind='circle', radius_m=0.01, period_s=5}]")
    assert [motion.kind for motion in task.scenario.motion] == ["circle"]


@pytest.mark.parametrize(
    ("entry", "why"),
    [
        ("jmp", "disturbance 'jmp' is unknown; .* did you mean jump"),
        ("camera.jiter_s=1", "unknown key camera.jiter_s; did you mean camera.jitter_s"),
        ("instrument.pulley=1", "no pulley; did you mean instrument.pulley_radius_m"),
        ("instrument.slack_m=tight", "'tight' is not a number; give one in SI units"),
        ("instrument.bending_stiffness=-1", "bending_stiffness"),
        ("duration_s=0", "duration_s: got 0 s, wanted 0.02 to 86400 s"),
        ("=3", "unknown key"),
        ("camera.width='640'", "camera.width: should be a valid integer, got '640'"),
        ("camera.width=640.0", "camera.width: should be a valid integer, got 640.0"),
        ("board.distance_m=true", "board.distance_m: should be a valid number, got true"),
        ("gravity=1", "gravity: should be a valid boolean, got 1"),
        ("instrument.tip_mass_kg=true", "tip_mass_kg: 'true' is not a number; give one in SI"),
        ("instrument.tip_mass_kg=1e6", "tip_mass_kg: got 1000000 kg, wanted 1e-06 to 0.5 kg"),
        ("instrument.slack_m=1e400", "slack_m: should be a finite number, got inf"),
        (f"duration_s=1{'0' * 5000}", "duration_s: should be a finite number, got inf"),
        (f"duration_s={'[' * 3000}", "duration_s: should be a valid number, got '"),
        ('summary="a\\u001b[2J"', "summary: got .*x1b.*wanted up to 200 printable"),
        ("motion=3", "motion: should be a valid tuple, got 3"),
        ("motion.0.travel_m=1", "motion is a list, and motion.0.travel_m is a part of it"),
        ("instrument.conduit_friction=2", "with the shaft at 1080 deg, wanted 0 to 20"),
    ],
)
def test_an_invalid_variation_gives_one_line(entry: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why) as caught:
        apply("shaft_bend_deg=1080", entry)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 700


def test_a_file_with_an_unknown_section_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("[instrumnt]\nslack_m = 0.0\n")
    with pytest.raises(ConfigError, match="disturbance mine: unknown key instrumnt; did you mean"):
        apply(str(file))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[instrument]\nslack_m = true", "instrument.slack_m: should be a valid number, got true"),
        ("[instrument_times]\nslack_m = '2'", "instrument_times.slack_m: should be a valid number"),
        ("[instrument_times]\ntip_mass_kg = 1e4", "tip_mass_kg: got 30 kg, wanted"),
        ("scenario.motion = 3", "motion: should be a valid tuple"),
        ("[[scenario.motion]]\nkind = 'sine'", "motion.1.sine"),
        (f"{'.'.join('a' * 2000)} = 1", "has values within values, more than 12 deep"),
        (f"a = {'[' * 5000}", "is not TOML"),
        (f"a = 1{'0' * 5000}", "is not TOML: Exceeds the limit"),
        (f"# {'x' * 2_000_000}", "is longer than 1000 kB"),
    ],
)
def test_a_file_with_wrong_values_is_refused_in_one_line(
    tmp_path: Path, text: str, why: str
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=why) as caught:
        apply(str(file))
    assert str(caught.value).isprintable()


def test_unstable_gains_need_force() -> None:
    request: dict[str, Any] = {"scenario": "straight", "vary": ("law.ki=4",), "vision": "truth"}
    with pytest.raises(ConfigError, match=r"pi is unstable .* gain margin 0\.\d+, above 1 needed"):
        Experiment(**request).resolve()
    assert Experiment(**request, force=True).resolve().settings.ki == 4
