"""Changes by KEY=VALUE and by file, laws from files, and what is said of bad ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from endolock.hw.api import ConfigError
from endolock.scripts import cli
from endolock.scripts.runs import overrides, run_folder
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
        ("instrument.slack_m=tight", "'tight' is no number; give one in SI units"),
        ("instrument.bending_stiffness=-1", "bending_stiffness"),
        ("duration_s=0", "duration_s: should be greater than 0"),
        ("=3", "unknown key"),
    ],
)
def test_a_variation_that_does_not_fit_is_one_line(entry: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why) as caught:
        apply(entry)
    assert "\n" not in str(caught.value)


def test_a_file_with_an_unknown_section_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("[instrumnt]\nslack_m = 0.0\n")
    with pytest.raises(ConfigError, match="disturbance mine: unknown key instrumnt; did you mean"):
        apply(str(file))


def test_gains_without_a_margin_need_force() -> None:
    request: dict[str, Any] = {"scenario": "straight", "vary": ("law.ki=4",), "vision": "truth"}
    with pytest.raises(ConfigError, match=r"pi is unstable .* gain margin 0\.\d+, above 1 needed"):
        Experiment(**request).resolve()
    assert Experiment(**request, force=True).resolve().settings.ki == 4


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ("return Command(position=(0.0,))", "position (0.0,) at 0.00 s; return two finite"),
        ("return Command(position=(float('nan') if t > 1 else 0.0, 0.0))", "(nan, 0.0) at 1.02 s"),
        ("return (0.0, 0.0)", "update returned tuple at 0.00 s; return endolock.hw.api.Command"),
        ("return None", "update returned NoneType"),
        ("return Command(position=['a', 'b'])", "position ['a', 'b']"),
        ("raise KeyError('gain')", "update failed: KeyError: 'gain' (line 8)"),
    ],
)
def test_a_law_that_goes_wrong_ends_the_run_with_one_line_and_a_closed_folder(
    body: str, why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "from endolock.hw.api import Command\n\n\n"
        "class Law:\n"
        "    def reset(self, state): pass\n"
        "\n"
        "    def update(self, t, state, observation):\n"
        f"        {body}\n\n\n"
        "def make(calibration): return Law()\n"
    )
    out = tmp_path / "run"
    args = ["run", "circle", "--controller", str(file), *QUICK, "--out", str(out)]
    assert cli.main(args) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert why in said
    assert "mine.py" in said
    rows = run_folder.read(out, "ticks")
    assert len(rows) == (52 if "1.02" in why else 1)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("x = 1", "defines no make(calibration)"),
        ("def make(calibration): return 3", "make returned int, which has no reset()"),
        ("import nothing_of_that_name", "cannot be run: ModuleNotFoundError"),
    ],
)
def test_a_file_that_makes_no_law_is_refused(text: str, why: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(text)
    request = Experiment(
        scenario="rest", controller=str(file), vision="truth", out=tmp_path / "run"
    )
    with pytest.raises(ConfigError) as caught:
        request.run()
    assert why in str(caught.value)
    assert not (tmp_path / "run").exists()


def test_a_good_law_from_a_file_runs(tmp_path: Path) -> None:
    file = tmp_path / "still.py"
    file.write_text(
        "from endolock.hw.api import Command\n\n\n"
        "class Law:\n"
        "    def reset(self, state): self.at = state.position\n"
        "    def update(self, t, state, seen): return Command(position=self.at)\n\n\n"
        "def make(calibration): return Law()\n"
    )
    request = Experiment(
        scenario="rest", controller=str(file), vision="truth", duration_s=1.0, out=tmp_path / "run"
    )
    record = request.run()
    assert record.controller == "still"
    assert record.error_px
    assert record.error_px.max
    assert record.error_px.max < 1.0  # nothing moves
