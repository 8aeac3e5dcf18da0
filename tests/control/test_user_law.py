"""Controllers from files and from Python: checks, parameters, output, and errors in one line."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from endolock import Calibration, Command, ConfigError, Experiment, read_run
from endolock.control import user_law
from endolock.control.user_code import Caller
from endolock.hw.errors import for_people
from endolock.scripts import cli
from endolock.scripts.runs import run_folder

QUICK = ["--vision", "truth", "--duration-s", "2"]
LAW = """
from endolock import Command

class Law:
    def __init__(self, angle): self.angle = angle
    def reset(self, state): pass
    def update(self, t, state, observation):
        self.signals = {"twice": 2 * self.angle}
        return Command(position=(self.angle, 0.0))

def make(calibration, angle=0.0, *, unused=1): return Law(angle)
"""


def run(file: Path, *vary: str) -> Experiment:
    """Half a second of a law from a file; its folder lies beside it."""
    return Experiment(
        scenario="rest",
        controller=str(file),
        vision="truth",
        vary=vary,
        duration_s=0.5,
        out=file.parent / "run",
    )


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ("return Command(position=(0.0,))", "position (0.0,) at 0.00 s; return two finite"),
        ("return Command(position=(float('nan') if t > 1 else 0.0, 0.0))", "(nan, 0.0) at 1.02 s"),
        ("return (0.0, 0.0)", "update returned tuple at 0.00 s; return endolock.Command"),
        ("return None", "update returned NoneType"),
        ("return Command(position=['a', 'b'])", "position ['a', 'b']"),
        ("raise KeyError('gain')", "update failed: KeyError: 'gain' (line 8)"),
    ],
)
def test_an_error_in_a_controller_ends_the_run_with_one_line_and_a_closed_folder(
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
        ("import nothing_of_that_name", "cannot be executed: ModuleNotFoundError"),
    ],
)
def test_a_file_without_a_controller_is_refused(text: str, why: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(text)
    request = Experiment(
        scenario="rest", controller=str(file), vision="truth", out=tmp_path / "run"
    )
    with pytest.raises(ConfigError) as caught:
        request.run()
    assert why in str(caught.value)
    assert not (tmp_path / "run").exists()


def test_a_controller_from_a_file_runs(tmp_path: Path) -> None:
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
    assert record.as_dict()["error_px"]["max"] < 1.0  # nothing moves


def test_parameters_of_make_are_set_by_vary_and_signals_are_recorded(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(LAW)
    record = run(file, "law.angle=0.25").run()
    last = read_run(record.folder).ticks.to_pylist()[-1]
    assert last["command_rad"] == [0.25, 0.0]
    assert last["signals"] == [("twice", 0.5)]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ("law.angel=1", "mine.py: make has no parameter angel; use angle, unused; did you mean"),
        ("law.calibration=1", "mine.py: make has no parameter calibration"),
    ],
)
def test_an_unknown_parameter_is_refused(change: str, why: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(LAW)
    with pytest.raises(ConfigError, match=why):
        run(file, change).resolve()


def test_a_file_is_executed_once_and_again_after_a_change(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.py"
    file.write_text(f"print('executed'){LAW}")
    run(file).run()
    out, err = capsys.readouterr()
    assert err.count("executed") == 1  # checked and made from one execution
    assert out == ""  # standard output belongs to --json -
    file.write_text(f"print('changed'){LAW}")
    user_law.load(str(file))
    assert "changed" in capsys.readouterr().err


def test_a_module_beside_the_file_can_be_imported_and_shadows_nothing(tmp_path: Path) -> None:
    (tmp_path / "gains_of_mine.py").write_text("ANGLE = 0.125\n")
    (tmp_path / "json.py").write_text("raise RuntimeError('shadows the standard library')\n")
    file = tmp_path / "mine.py"
    text = LAW.replace("return Law(angle)", "return Law(gains_of_mine.ANGLE)")
    file.write_text(f"import json.decoder\nimport gains_of_mine\n{text}")
    assert json_decoder_of(user_law.load(str(file)))
    ticks = read_run(run(file).run().folder).ticks
    assert ticks["command_rad"][-1].as_py() == [0.125, 0.0]


@pytest.mark.parametrize("name", ["name", "what", "call", "source", "file", "method"])
def test_a_parameter_may_have_any_name(name: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(LAW.replace("angle=0.0", f"{name}=0.0").replace("Law(angle)", f"Law({name})"))
    record = run(file, f"law.{name}=0.25").run()
    assert read_run(record.folder).ticks["command_rad"][-1].as_py() == [0.25, 0.0]


def test_a_make_that_takes_everything_gets_everything(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    text = LAW.replace("angle=0.0, *, unused=1", "**given")
    file.write_text(text.replace("Law(angle)", 'Law(given["gain"])'))
    assert run(file, "law.gain=0.25").resolve().settings == {"gain": 0.25}


def test_a_parameter_without_a_default_is_asked_for(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(LAW.replace("angle=0.0", "angle"))
    with pytest.raises(ConfigError, match=r"make needs law\.angle; give it with --vary law"):
        run(file).resolve()


def test_modules_beside_two_files_may_have_the_same_name(tmp_path: Path) -> None:
    ends = []
    for folder, angle in (("a", 0.125), ("b", 0.25)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "gains_of_both.py").write_text(f"ANGLE = {angle}\n")
        file = tmp_path / folder / "mine.py"
        text = LAW.replace("return Law(angle)", "return Law(gains_of_both.ANGLE)")
        file.write_text(f"import gains_of_both\n{text}")
        ticks = read_run(run(file).run().folder).ticks
        ends.append(ticks["command_rad"][-1].as_py()[0])
    assert ends == [0.125, 0.25]


def json_decoder_of(law: user_law.UserLaw) -> bool:
    """Whether the standard library's json was imported by the file."""
    return hasattr(law.function.__globals__["json"].decoder, "JSONDecoder")


def test_an_error_names_the_line_in_the_file_itself(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(LAW.replace("self.signals = ", "import math; math.sqrt(-1.0); x = "))
    with pytest.raises(ConfigError, match=r"update failed: ValueError: .* \(line 8\)"):
        run(file).run()
    file.write_text(LAW.replace("self.signals = {", "import numpy; numpy.linalg.inv([[0.0]]); {"))
    with pytest.raises(ConfigError, match=r"mine\.py: update failed: .*\(line 8\)"):
        replace(run(file), out=tmp_path / "second").run()  # not the line in NumPy that raises
    file.write_text("def make(calibration:\n")
    with pytest.raises(ConfigError, match=r"mine\.py: cannot be executed: SyntaxError: .*line 1"):
        run(file).resolve()


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (
            "def make(calibration, angle=0.0, *, unused=1): return Law(angle)",
            "def make(): ...",
            r"make failed: TypeError: .* \(line 11\)",
        ),
        (
            "def update(self, t, state, observation):",
            "def update(self, t):",
            r"update failed: TypeError: .* \(line 7\)",
        ),
        ("self.signals = ", "exit(); x = ", r"update failed: SystemExit: None \(line 8\)"),
        ("self.signals = {", "self.signals = 5; {", "signals is 5; make it a mapping of names"),
        ("self.signals = {", "{", "signals failed: AttributeError: .* 'gian'"),
        ("position=(self.angle, 0.0)", "position='12'", "update returned the position '12'"),
        (
            "position=(self.angle, 0.0)",
            "position={0: 1, 1: 2}",
            "update returned the position {0: 1",
        ),
    ],
)
def test_what_a_file_does_wrong_is_one_line_that_names_its_own_line(
    old: str, new: str, why: str, tmp_path: Path
) -> None:
    file = tmp_path / "mine.py"
    text = LAW.replace(old, new)
    if "gian" in why:
        text = text.replace("class Law:", "class Law:\n    signals = property(lambda s: s.gian)")
    file.write_text(text)
    with pytest.raises(ConfigError, match=rf"^mine\.py: {why}"):
        run(file).run()


RAISED = {
    "sys.exit(0)": "SystemExit: 0",
    "sys.exit('bye')": "SystemExit: bye",
    "raise KeyboardInterrupt": "KeyboardInterrupt: no message",
    "raise GeneratorExit": "GeneratorExit: no message",
    "raise Own('mine')": "Own: mine",
    "raise Dumb": "Dumb: its message cannot be shown",
}
"""What a law may raise, and what is said about it."""
WHERE = {
    "": "cannot be executed",
    "make": "make failed",
    "reset": "reset failed",
    "update": "update failed",
    "signals": "signals failed",
}
"""Where a law may raise it."""
RAISING = """
import sys
from endolock import Command

class Own(BaseException): ...
class Dumb(Exception):
    def __str__(self): raise self

def at(place):
    if place == "{place}":
        {raised}

class Law:
    def reset(self, state): at("reset")
    @property
    def signals(self): at("signals"); return {{}}
    def update(self, t, state, observation): at("update"); return Command(position=(0.0, 0.0))

def make(calibration): at("make"); return Law()
at("")
"""


def brief(file: Path, **changes: Any) -> Experiment:
    """A tenth of a second of a law from a file, without physics."""
    return replace(run(file), rig="surrogate", duration_s=0.1, **changes)


@pytest.mark.parametrize("place", WHERE)
@pytest.mark.parametrize("raised", RAISED)
def test_whatever_a_law_raises_anywhere_is_one_line_with_its_place(
    raised: str, place: str, tmp_path: Path
) -> None:
    file = tmp_path / "mine.py"
    file.write_text(RAISING.format(place=place, raised=raised))
    with pytest.raises(ConfigError) as caught:
        brief(file).run()
    assert str(caught.value) == f"mine.py: {WHERE[place]}: {RAISED[raised]} (line 11)"
    assert not (tmp_path / "run" / "metrics.json").exists()


def test_an_exit_of_a_module_beside_the_law_names_the_line_that_imports_it(tmp_path: Path) -> None:
    (tmp_path / "beside_of_mine.py").write_text("raise SystemExit('usage: ...')\n")
    file = tmp_path / "mine.py"
    file.write_text(f"import beside_of_mine\n{LAW}")
    with pytest.raises(ConfigError, match=r"cannot be executed: SystemExit: usage: .*\(line 1\)"):
        brief(file).resolve()


def test_an_error_of_endolock_keeps_its_type_and_message(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "from endolock import ConfigError, DeviceFault"
        + LAW.replace("pass", "raise ConfigError('gain 9', 'use 1')")
    )
    with pytest.raises(ConfigError, match="gain 9; use 1") as caught:
        brief(file).run()
    assert for_people(caught.value) == "gain 9; use 1; raised by mine.py (line 6)"


def test_no_run_depends_on_what_another_left_in_the_file_or_the_process(tmp_path: Path) -> None:
    (tmp_path / "state_of_mine.py").write_text("CALLS = []\n")
    (tmp_path / "elsewhere").mkdir()
    file = tmp_path / "mine.py"
    text = LAW.replace("pass", "os.chdir(FOLDER); np.seterr(all='raise'); sys.stdout = None")
    text = text.replace("(self.angle, 0.0)", "(0.01 * len(state_of_mine.CALLS), 0.0)").replace(
        "self.signals = ", "state_of_mine.CALLS.append(t); sys.stdout = None; x = "
    )
    file.write_text(f"import os, sys\nimport numpy as np\nimport state_of_mine\n{text}")
    file.write_text(file.read_text().replace("FOLDER", repr(str(tmp_path / "elsewhere"))))
    here, stdout, errors = Path.cwd(), sys.stdout, np.geterr()
    records = [brief(file, out=tmp_path / name).run() for name in ("a", "b")]
    first, second = (read_run(record.folder).ticks for record in records)
    assert first.equals(second)
    assert first["command_rad"][-1].as_py()[0] == pytest.approx(0.05)  # 5 of 6 updates were sent
    assert (Path.cwd(), np.geterr()) == (here, errors)
    assert sys.stdout is stdout


def test_a_law_may_change_the_folder_though_the_run_folder_is_relative(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "mine.py"
    file.write_text("import os\n" + LAW.replace("pass", "os.chdir('/')"))
    record = brief(file, out=Path("run")).run()
    assert read_run(record.folder).record == record
    assert (tmp_path / "run" / "metrics.json").exists()


def test_laws_in_several_threads_print_to_standard_error_and_others_where_they_like(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def shout(text: str) -> None:
        for _ in range(200):
            print(text)

    callers = [Caller(name, None, copy_context(), quiet=True) for name in "abc"]
    with ThreadPoolExecutor(4) as pool:
        laws = [(caller, partial(shout, f"law {caller.name}")) for caller in callers]
        done = [pool.submit(caller.call, "update", law) for caller, law in laws]
        done.append(pool.submit(shout, "user"))
        for task in done:
            task.result()
    out, err = capsys.readouterr()
    assert out == "user\n" * 200
    assert len(err.split()) == 3 * 200 * 2
    print("afterwards")
    assert capsys.readouterr().out == "afterwards\n"


@pytest.mark.parametrize(
    ("parameter", "change", "got"),
    [
        ("gain=1.0", "law.gain=.5", 0.5),
        ("gain=1.0", "law.gain=5.", 5.0),
        ("gain=1.0", "law.gain=1e-3", 0.001),
        ("gain=1", "law.gain=1.5", 1.5),  # a default of 1 may stand for 1.0
        ("gain: int = 1", "law.gain=2", 2),
        ("gain: 'float' = 1", "law.gain=-.5e1", -5.0),
        ("on=False", "law.on=true", True),
        ("name='x'", "law.name=abc", "abc"),
        ("anything=None", "law.anything=abc", "abc"),
    ],
)
def test_a_parameter_gets_a_value_of_its_kind(
    parameter: str, change: str, got: object, tmp_path: Path
) -> None:
    file = tmp_path / "mine.py"
    file.write_text(LAW.replace("angle=0.0", parameter))
    (value,) = run(file, change).resolve().settings.values()
    assert (type(value), value) == (type(got), got)


@pytest.mark.parametrize(
    ("parameter", "change", "why"),
    [
        ("gain=1.0", "law.gain=abc", r"law.gain is 'abc'; give a number"),
        ("gain=1.0", "law.gain=true", r"law.gain is True; give a number"),
        ("gain: float = None", "law.gain=1,5", r"law.gain is '1,5'; give a number"),
        ("gain: int = 1", "law.gain=1.5", r"law.gain is 1.5; give a whole number"),
        ("on=False", "law.on=1", r"law.on is 1; give true or false"),
    ],
)
def test_a_value_of_another_kind_is_refused(
    parameter: str, change: str, why: str, tmp_path: Path
) -> None:
    file = tmp_path / "mine.py"
    file.write_text(LAW.replace("angle=0.0", parameter))
    with pytest.raises(ConfigError, match=rf"^mine\.py: {why}"):
        run(file, change).resolve()


class Steady:
    """Holds one angle; an object made in Python."""

    def __init__(self) -> None:
        self.signals = {"angle": 0.5}

    def reset(self, state: object) -> None:
        """Nothing to forget."""

    def update(self, t: float, state: object, observation: object) -> Command:
        """Always the same."""
        return Command(position=(0.5, 0.0))


def steady(calibration: Calibration) -> Steady:
    """Make one from the calibration."""
    return Steady()


@pytest.mark.parametrize("controller", [Steady(), steady])
def test_an_object_a_class_or_a_function_gets_a_run_folder(
    controller: object, tmp_path: Path
) -> None:
    record = Experiment(
        scenario="rest",
        controller=controller,  # type: ignore[arg-type]  # any object with the two methods
        vision="truth",
        duration_s=0.5,
        out=tmp_path / "run",
    ).run()
    assert record.controller == ("Steady" if isinstance(controller, Steady) else "steady")
    ticks = read_run(record.folder).ticks
    assert ticks["command_rad"][-1].as_py() == [0.5, 0.0]
    assert ticks["signals"][-1].as_py() == [("angle", 0.5)]


def test_an_object_without_the_methods_is_refused(tmp_path: Path) -> None:
    experiment = Experiment(
        scenario="rest",
        controller=3,  # type: ignore[arg-type]  # on purpose
        vision="truth",
        out=tmp_path / "run",
    )
    with pytest.raises(ConfigError, match="3 has no update"):
        experiment.run()
    assert not (tmp_path / "run").exists()


class Unmakeable:
    """Takes no calibration."""

    def __init__(self) -> None:
        """Take nothing."""


@pytest.mark.parametrize(
    ("controller", "why"),
    [
        (Unmakeable, "Unmakeable: making it from the calibration failed: TypeError"),
        (lambda calibration: None, "NoneType, which has no reset"),
        (lambda calibration: Steady, "the class Steady, which has no reset"),
    ],
)
def test_what_makes_no_controller_is_refused(controller: Any, why: str, tmp_path: Path) -> None:
    experiment = Experiment(
        scenario="rest", controller=controller, vision="truth", out=tmp_path / "run"
    )
    with pytest.raises(ConfigError, match=why):
        experiment.run()
