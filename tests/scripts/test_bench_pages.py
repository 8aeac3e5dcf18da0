"""The pages on bench and safety: their commands exist, their numbers are those of the code."""

import re
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from tests.hw.served import Served, servo

from endolock.hw.api import Command
from endolock.scripts.commands.doctor import port_checks

ROOT = Path(__file__).parents[2]
BENCH, SAFETY = (ROOT / "docs" / name for name in ("bench.md", "safety.md"))
ROW = re.compile(r"^\| `([\w.]+)` \| (\S+)(?: (\S+))? \| ([\w/]+)\.py \|$", re.MULTILINE)
COMMANDS = re.findall(r"\./run endolock (\w+)([^`#\n]*)", BENCH.read_text())


def _value(file: str, name: str) -> Any:
    """A constant of a file, or the default of a field of a class in it."""
    value: Any = import_module(f"endolock.{file.replace('/', '.')}")
    for part in name.split("."):
        fields = getattr(value, "model_fields", {})
        value = fields[part].default if part in fields else getattr(value, part)
    return value


def test_the_numbers_of_the_page_are_those_of_the_code() -> None:
    rows = ROW.findall(SAFETY.read_text())
    assert len(rows) == len(re.findall(r"^\| `", SAFETY.read_text(), re.MULTILINE)) - 1  # estop
    for name, value, _, file in rows:
        stated = int(value, 16) if value.startswith("0x") else float(value)
        assert stated == _value(file, name), name


def test_every_number_on_the_page_is_a_constant() -> None:
    """Every time and rate on the page is one of the constants."""
    known = {f"{value} {unit}" for _, value, unit, _ in ROW.findall(SAFETY.read_text())}
    given = set(re.findall(r"[\d.]+ (?:s|rad/s|rad)\b", SAFETY.read_text()))
    assert len(given) > 4
    assert given <= known


def test_every_fault_that_relaxes_a_motor_is_named() -> None:
    shutdown = _value("hw/dynamixel/registers", "DEFAULT_SHUTDOWN")
    errors = _value("hw/dynamixel/registers", "HARDWARE_ERRORS")
    kinds = {bit: kind for bit, (kind, *_) in errors.items() if bit & shutdown}
    assert kinds == {0x04: "overheat", 0x10: "voltage", 0x20: "overload"}
    assert "| overload, overheat, electrical shock |" in SAFETY.read_text()


@pytest.mark.parametrize(("command", "words"), COMMANDS, ids=[c + w for c, w in COMMANDS])
def test_commands_of_the_page_exist(command: str, words: str) -> None:
    module = {"doctor": "doctor.examination"}.get(command, command)
    fields = import_module(f"endolock.scripts.commands.{module}").Request.__dataclass_fields__
    for option in re.findall(r"--([\w-]+)", words):
        assert option.replace("-", "_") in fields


def test_links_of_the_pages_exist() -> None:
    for page in (BENCH, SAFETY):
        for link in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
            assert (page.parent / link).exists(), link


def test_the_udev_rule_is_the_one_of_doctor() -> None:
    assert f"\n    {port_checks.UDEV_RULE}\n" in BENCH.read_text()
    assert f"`{port_checks.UDEV_FILE}`" in BENCH.read_text()


def test_a_new_motor_gets_its_id() -> None:
    (code,) = (block for block in _blocks() if "reg.ID" in block)
    motor = servo(1, baud=57_600)
    with Served(motor) as served:
        exec(compile(code.replace('"PORT"', repr(served.path)), "bench.md", "exec"), {})
    assert motor.id == 2


def test_the_controller_on_the_page_runs() -> None:
    (code,) = (block for block in _blocks() if "class Still" in block)
    names: dict[str, Any] = {}
    exec(compile(code, "still.py", "exec"), names)
    law = names["make"](None)

    class Standing:
        position = 0.3, -0.2

    law.reset(Standing)
    assert law.update(0.0, None, None) == Command(position=(0.3, -0.2))


def _blocks() -> list[str]:
    return re.findall(r"```python\n(.*?)```", BENCH.read_text(), re.DOTALL)
