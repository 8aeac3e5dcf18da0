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
    ],
)
def test_an_invalid_variation_gives_one_line(entry: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why) as caught:
        apply(entry)
    assert "\n" not in str(caught.value)


def test_a_file_with_an_unknown_section_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("[instrumnt]\nslack_m = 0.0\n")
    with pytest.raises(ConfigError, match="disturbance mine: unknown key instrumnt; did you mean"):
        apply(str(file))


def test_unstable_gains_need_force() -> None:
    request: dict[str, Any] = {"scenario": "straight", "vary": ("law.ki=4",), "vision": "truth"}
    with pytest.raises(ConfigError, match=r"pi is unstable .* gain margin 0\.\d+, above 1 needed"):
        Experiment(**request).resolve()
    assert Experiment(**request, force=True).resolve().settings.ki == 4
