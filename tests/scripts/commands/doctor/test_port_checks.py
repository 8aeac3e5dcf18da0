"""The doctor on serial ports: what it tells of emulated motors, and how it sets them up."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Timer
from typing import Any

import pytest
from tests.hw.served import Served, servo

from endolock.hw.api import ConfigError, Mode
from endolock.hw.bench import bench_file
from endolock.hw.bench.wall_clock import WallClock
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.models import XM430_W350
from endolock.hw.dynamixel.packets import Instruction
from endolock.hw.dynamixel.port import Port, serial_port
from endolock.hw.dynamixel.registers import Units
from endolock.hw.dynamixel.servo_bus import Bus
from endolock.hw.dynamixel.servo_drive import ServoDrive
from endolock.hw.dynamixel.settings import SETTINGS, Wish
from endolock.hw.emulator.servo_model import Servo
from endolock.hw.guard import Guard
from endolock.scripts.commands.doctor import (
    examination,
    motor_checks,
    motor_setup,
    port_checks,
)
from endolock.scripts.commands.doctor.finding import Finding
from endolock.scripts.commands.doctor.found_motor import FoundMotor

pytestmark = pytest.mark.wall_time

STEP_RAD = Units().position_rad
SHORT = (0.1,)
"""One search, which a busy machine answers within its 0.1 s a rate."""
NAMES = [
    "motors",
    "firmware",
    "baud",
    "status return level",
    "return delay",
    "drive mode",
    "secondary id",
    "homing offset",
    "PWM limit",
    "current limit",
    "startup configuration",
    "shutdown",
    "settings",
    "hardware error",
    "watchdog",
    "torque",
    "bench",
]
FREE = Wish(handle=Handle(id=1), model=XM430_W350, units=XM430_W350.units)
GOOD = FoundMotor(
    id=1,
    model=1020,
    firmware=45,
    baud=1_000_000,
    settings={setting.name: setting.wanted(FREE) or 0 for setting in SETTINGS},
)


def put(servo: Servo, register: reg.Register, value: int) -> None:
    """Store what no bus could write."""
    servo._store(register, value)


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every bench.toml is of this test alone."""
    monkeypatch.chdir(tmp_path)


def examine(
    path: str, *, set_up: bool = False, searches_s: Sequence[float] = SHORT
) -> list[Finding]:
    change = motor_setup.set_up if set_up else None
    return port_checks.examine(
        path, lambda _: None, change=change, searches_s=searches_s, wait_s=0.0
    )


def set_up(line: Port, *motors: FoundMotor) -> Finding:
    return motor_setup.set_up(line, motors)


@contextmanager
def opened(path: str) -> Iterator[Port]:
    line = serial_port(path, 1_000_000)
    line.open()
    try:
        yield line
    finally:
        line.close()


CLOSED = serial_port("nowhere", 1_000_000)
"""A port that was never opened: every call raises."""


def red(findings: Sequence[Finding]) -> list[str]:
    assert all(bool(f.advice) != f.ok for f in findings)
    return [finding.name for finding in findings if not finding.ok]


# ---- ports that are not opened


def test_serial_ports_are_listed_once_by_the_name_of_their_device(tmp_path: Path) -> None:
    (tmp_path / "ttyUSB0").touch()
    (tmp_path / "ttyACM1").touch()
    by_id = tmp_path / "serial" / "by-id"
    by_id.mkdir(parents=True)
    (by_id / "usb-FTDI_Converter_FT1-if00-port0").symlink_to("../../ttyUSB0")
    finding = port_checks.serial(tmp_path, tmp_path / "nowhere")
    assert finding.ok
    assert finding.text == "ttyUSB0 (usb-FTDI_Converter_FT1-if00-port0), ttyACM1"


def test_a_slow_latency_timer_names_the_rule_that_makes_it_fast(tmp_path: Path) -> None:
    for name, timer in (("ttyUSB0", "16\n"), ("ttyUSB1", "1\n")):
        (tmp_path / name).touch()
        (tmp_path / "sys" / name).mkdir(parents=True)
        (tmp_path / "sys" / name / "latency_timer").write_text(timer)
    finding = port_checks.serial(tmp_path, tmp_path / "sys")
    assert not finding.ok
    assert finding.text == (
        "ttyUSB0 (latency timer 16 ms), ttyUSB1 (latency timer 1 ms); the timer of ttyUSB0 slows "
        "every cycle (16 ms: 58 cycles/s)"
    )
    assert finding.advice == (
        'write the line ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", '
        'ATTR{latency_timer}="1" into /etc/udev/rules.d/99-endolock.rules, then sudo udevadm '
        "control --reload, and plug the adapter in again"
    )
    (tmp_path / "sys" / "ttyUSB0" / "latency_timer").write_text("1\n")
    assert port_checks.serial(tmp_path, tmp_path / "sys").ok


def test_a_port_that_may_not_be_opened_names_the_group_to_join() -> None:
    found = {"ttyUSB0": "ttyUSB0", "ttyACM1": "ttyACM1"}
    finding = port_checks.ports(found, {"ttyUSB0": "dialout"}, {})
    assert not finding.ok
    assert finding.text == "ttyUSB0, ttyACM1; no permission to open ttyUSB0"
    assert finding.advice == "sudo usermod -aG dialout $USER, then log in again"
    assert port_checks.ports({}, {}, {}).text == "none; the twin needs none"


# ---- what doctor reports about a port and motors


def test_motors_with_factory_settings_fail_until_set_up(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = servo(1, 0.31, baud=57_600), servo(2, -0.17, baud=57_600)
    put(second, reg.DRIVE_MODE, 1)
    second.write(reg.HOMING_OFFSET.address, (-512).to_bytes(4, "little", signed=True))
    second._shift += 3 * reg.TURN  # it counted turns since it was switched on
    with Served(first, second) as served:
        port, motors, *rows = findings = examine(served.path)
        assert port == Finding("port", True, f"{served.path} opened")
        assert motors == Finding(
            "motors",
            True,
            "1 (XM430-W350, firmware 45, 57600 baud), 2 (XM430-W350, firmware 45, 57600 baud)",
        )
        assert [row.name for row in findings[1:]] == NAMES
        assert red(findings) == ["baud", "return delay", "drive mode", "homing offset", "bench"]
        cure = f"straighten the endoscope, then endolock doctor --port {served.path} --set-up"
        said = {row.name: (row.text, row.advice) for row in rows}
        assert said["baud"] == (
            "1: 57600, 2: 57600",
            f"this is slow, the factory setting of 57600 gives 55 cycles/s: {cure}",
        )
        assert said["return delay"] == (
            "1: 250 (500 us), 2: 250 (500 us)",
            f"every answer is delayed by this time: {cure}",
        )
        assert said["homing offset"] == (
            "1: 0, 2: -512",
            f"with an offset a motor creeps after its watchdog has stopped it: {cure}",
        )
        assert said["bench"] == (
            "no bench.toml here, so up_down 1, left_right 2 at 1000000 baud; motor 1 at 57600 and "
            "2 at 57600",
            cure,
        )

        monkeypatch.setattr(
            examination, "attempt", lambda name, *_: Finding(name, True, "not here")
        )
        assert examination.main(examination.Request(port=served.path, set_up=True, json="-")) == 0
        printed = capsys.readouterr()
        assert "the endoscope must be straight now; Ctrl-C if it is not" in printed.err
        report = json.loads(printed.out)
        assert report["ok"] is True
        checks = {check["name"]: check["text"] for check in report["checks"]}
        assert list(checks)[-len(NAMES) - 3 :] == ["versions", "port", "set-up", *NAMES]
        assert checks["set-up"] == (
            "1: return delay 250 -> 0, baud 57600 -> 1000000; 2: return delay 250 -> 0, drive mode "
            "1 -> 0, homing offset -512 -> 0, baud 57600 -> 1000000; up_down 1 with its zero at "
            "2048; left_right 2 with its zero at 2048; wrote bench.toml"
        )
        assert checks["bench"] == "bench.toml: up_down 1, left_right 2 at 1000000 baud"

        bench = bench_file.load()
        clock = WallClock()
        names = {handle.id: axis for axis, handle in bench.handles.items()}
        drive = ServoDrive(
            Bus(serial_port(served.path, bench.baud), clock, names), clock, bench.handles
        )
        with Guard(drive) as guard:
            state = guard.enable()
            assert state.mode is Mode.HOLDING
            assert state.position == pytest.approx((0.0, 0.0), abs=STEP_RAD)  # straight is zero


def test_looking_for_motors_only_reads() -> None:
    servos = servo(1, baud=57_600), servo(2, baud=1_000_000)
    servos[1].write(reg.TORQUE_ENABLE.address, b"\x01")
    before = [bytes(s._table[: reg.TICK.address]) for s in servos]  # above, it measures itself
    with Served(*servos) as served:
        findings = examine(served.path)
        assert served.bus.asked == {Instruction.PING, Instruction.READ}
        assert [bytes(s._table[: reg.TICK.address]) for s in servos] == before
        assert red(findings) == ["baud", "return delay", "torque", "bench"]
    assert not bench_file.DEFAULT_FILE.exists()


@pytest.mark.parametrize(
    ("row", "change", "text", "advice"),
    [
        (
            "motors",
            {"model": 1200},
            "1 (XM430-W350, firmware 45, 1000000 baud), 2 (XL330-M288, firmware 45, 1000000 baud)",
            "XL330-M288: its indirect data are elsewhere, and its current is in 1 mA; use X series "
            "of the size 430 or 540 that measure their current, such as XM430-W350",
        ),
        (
            "firmware",
            {"firmware": 37},
            "1: 45, 2: 37",
            "below 38 there is no bus watchdog: update it with the maker's DYNAMIXEL Wizard",
        ),
        (
            "hardware error",
            {"hardware_error": 0x24},
            "1: none, 2: it is too hot (overheat): let it cool, its load is too high for too long "
            "(overload): free the handle",
            "do that, then switch the motors' supply off and on",
        ),
        (
            "watchdog",
            {"watchdog": reg.TRIPPED},
            "1: off, 2: has stopped the motor",
            "its program stopped sending; the next program to connect relaxes the motor and clears "
            "this, as does switching the supply off: hold the endoscope",
        ),
        (
            "torque",
            {"torque": 1},
            "1: off, 2: on",
            "it holds though no program has the port; the next program to connect relaxes the "
            "motor, as does switching the supply off: hold the endoscope",
        ),
    ],
)
def test_each_problem_has_its_row(row: str, change: dict[str, Any], text: str, advice: str) -> None:
    motors = [GOOD, dataclasses.replace(dataclasses.replace(GOOD, id=2), **change)]
    findings = motor_checks.judge(motors, "PORT")
    assert [finding.name for finding in findings] == NAMES
    assert red(findings) == [row]
    assert next(f for f in findings if f.name == row) == Finding(row, False, text, advice)


@pytest.mark.parametrize(
    ("row", "value", "text"),
    [
        ("drive mode", 4, "1: 0, 2: 4"),
        ("secondary id", 1, "1: 255, 2: 1"),
        ("PWM limit", 400, "1: 885, 2: 400"),
        ("startup configuration", 2, "1: 0, 2: 2"),
        ("shutdown", 0, "1: 52, 2: 0"),
    ],
)
def test_each_setting_that_others_left_has_its_row(row: str, value: int, text: str) -> None:
    other = dataclasses.replace(GOOD, id=2, settings={**GOOD.settings, row: value})
    findings = motor_checks.judge([GOOD, other], "PORT")
    assert [finding.name for finding in findings] == NAMES
    assert red(findings) == [row]
    finding = next(f for f in findings if f.name == row)
    assert finding.text == text
    why = next(setting.why for setting in SETTINGS if setting.name == row)
    assert finding.advice == (
        f"{why}: straighten the endoscope, then endolock doctor --port PORT --set-up"
    )


def test_what_connecting_sets_is_told_and_is_no_problem() -> None:
    left = {**GOOD.settings, "position P": 640, "goal PWM": 100}
    findings = motor_checks.judge([GOOD, dataclasses.replace(GOOD, id=2, settings=left)], "PORT")
    assert red(findings) == []
    assert next(f.text for f in findings if f.name == "settings") == (
        "set at connecting: 2: position P 640 -> 800, 2: goal PWM 100 -> 885"
    )


def test_a_current_limit_is_compared_with_that_of_the_bench_file() -> None:
    bench_file.DEFAULT_FILE.write_text("[handle.left_right]\nid = 2\ncurrent_limit_a = 1.0\n")
    left = {**GOOD.settings, "current limit": 371}
    motors = [GOOD, dataclasses.replace(GOOD, id=2, settings=left)]
    findings = {finding.name: finding for finding in motor_checks.judge(motors, "PORT")}
    assert findings["current limit"] == Finding(
        "current limit",
        False,
        "1: 0 (0 A), 2: 371 (0.998 A)",
        "the motor does not accept the current_limit_a of its handle: use a smaller "
        "current_limit_a, or raise the motor's with the maker's DYNAMIXEL Wizard",
    )


@pytest.mark.parametrize(
    ("level", "text"), [(1, "1: 2, 2: 1"), (0, "1: 2, 2: 0 (it answers to pings only)")]
)
def test_a_status_level_left_by_others_is_named_and_the_set_up_heals_it(
    level: int, text: str
) -> None:
    servos = servo(1), servo(2)
    servos[1].write(reg.STATUS_LEVEL.address, bytes([level]))
    with Served(*servos) as served:
        findings = {finding.name: finding for finding in examine(served.path)}
        assert findings["status return level"] == Finding(
            "status return level",
            False,
            text,
            "another program left it, and the motor does not answer to everything; the next "
            "program to connect sets it to 2, as does switching the supply off and on: then run "
            "this again",
        )
        told = [findings[name].text for name in ("hardware error", "watchdog", "torque")]
        assert ("1: off, 2: unknown" in told) is (level == 0)
        assert servos[1].status_level == level  # looking changes nothing
        assert red(examine(served.path, set_up=True)) == []


def test_the_set_up_writes_all_that_the_rows_name() -> None:
    servos = servo(1), servo(2)
    for register, value in (
        (reg.SECONDARY_ID, 1),
        (reg.DRIVE_MODE, 13),
        (reg.PWM_LIMIT, 100),
        (reg.STARTUP, 3),
        (reg.SHUTDOWN, 1),
        (reg.HOMING_OFFSET, 77),
    ):
        servos[1].write(register.address, register.encode(value))
    servos[1].reboot()
    with Served(*servos) as served:
        findings = examine(served.path, set_up=True)
        assert red(findings) == []
        assert findings[1].text == (
            "1: return delay 250 -> 0; 2: return delay 250 -> 0, drive mode 13 -> 0, secondary id "
            "1 -> 255, homing offset 77 -> 0, PWM limit 100 -> 885, startup configuration 3 -> 0, "
            "shutdown 1 -> 52; up_down 1 with its zero at 2048; left_right 2 with its zero at "
            f"{servos[1]._position()}; wrote bench.toml"
        )


def test_motors_that_are_not_those_of_the_bench_file() -> None:
    cure = (
        "move bench.toml away, straighten the endoscope, then endolock doctor --port PORT --set-up"
    )
    other = dataclasses.replace(GOOD, id=7)

    def bench(text: str, *motors: FoundMotor) -> Finding:
        bench_file.DEFAULT_FILE.write_text(text)
        *_, finding = motor_checks.judge(motors, "PORT")
        assert finding.name == "bench"
        return finding

    assert bench("baud = 1000000", GOOD, other) == Finding(
        "bench",
        False,
        "bench.toml: up_down 1, left_right 2 at 1000000 baud; motor 2 (left_right) does not "
        "answer, but 1, 7",
        f"check its supply and cable, or {cure}",
    )
    assert bench("[handle.left_right]\nid = 7", GOOD, other).ok
    assert bench("baud = 2000000\n[handle.left_right]\nid = 7", GOOD, other) == Finding(
        "bench",
        False,
        "bench.toml: up_down 1, left_right 7 at 2000000 baud; motor 1 at 1000000 and 7 at 1000000",
        cure,
    )
    broken = bench("baud = ", GOOD, other)
    assert broken.text.startswith("bench bench.toml is not TOML: ")
    assert broken.advice == "correct the file"
    assert bench("buad = 1000000", GOOD, other) == Finding(
        "bench", False, "bench bench.toml: unknown key buad", "did you mean baud?"
    )


def test_no_motor_at_all() -> None:
    with Served() as served:
        tried: list[str] = []
        findings = port_checks.examine(served.path, tried.append, searches_s=(0.01, 0.02))
    assert findings[1:] == [
        Finding(
            "motors",
            False,
            "none answers at any rate from 9600 to 4500000 baud",
            "switch the motors' supply on and plug the data cable in; if two have the same id, as "
            "new ones have, connect one alone and give it another (docs/bench.md)",
        )
    ]
    assert tried == 2 * [f"motors at {baud} baud" for baud in reg.BAUDS]


@pytest.mark.parametrize("bauds", [(57_600, 57_600), (57_600, 1_000_000)])
def test_two_motors_with_one_id_are_not_touched(bauds: tuple[int, int]) -> None:
    with Served(*(servo(1, baud=baud) for baud in bauds)) as served:
        findings = examine(served.path, set_up=True)
        assert Instruction.WRITE not in served.bus.asked
    assert findings[1:] == [
        Finding(
            "motors",
            False,
            "answers with the id 1 come twice or damaged: several motors have it, or the cable is "
            "bad",
            "connect one motor alone, give it another id (docs/bench.md), then connect both",
        )
    ]
    assert not bench_file.DEFAULT_FILE.exists()


def test_the_persistent_name_of_a_port_is_preferred(tmp_path: Path) -> None:
    with Served() as served:
        (tmp_path / "usb-FTDI").symlink_to(served.path)

        def port(path: str | Path) -> str:
            findings = port_checks.examine(
                str(path), lambda _: None, by_id=tmp_path, searches_s=(0.001,)
            )
            return findings[0].text

        assert port(served.path) == (
            f"{served.path} opened; prefer {tmp_path}/usb-FTDI: it stays the same across USB ports"
        )
        assert port(tmp_path / "usb-FTDI") == f"{tmp_path}/usb-FTDI opened"


def test_a_port_in_use_by_another_program_is_a_red_row() -> None:
    with Served() as served:
        other = serial_port(served.path, 1_000_000)
        other.open()
        try:
            findings = examine(served.path)
        finally:
            other.close()
        assert findings == [
            Finding(
                "port",
                False,
                f"{served.path} is in use by another program",
                "close that program, then run this again",
            )
        ]


def test_ports_that_cannot_be_opened_are_red_rows(tmp_path: Path) -> None:
    there = "plug it in, and give a port that the row serial lists"
    assert examine("ttyUSB7") == [
        Finding("port", False, "ttyUSB7 cannot be opened (No such file or directory)", there)
    ]
    (tmp_path / "file").touch()
    assert examine("file") == [
        Finding(
            "port",
            False,
            "file is not a serial port (Inappropriate ioctl for device)",
            "see the row 'serial', or give a port that it lists",
        )
    ]


def test_a_port_that_is_made_a_moment_later_is_waited_for(tmp_path: Path) -> None:
    with Served(servo(1), servo(2)) as served:
        link = tmp_path / "servo"
        later = Timer(0.5, link.symlink_to, [served.path])
        later.start()
        findings = port_checks.examine(str(link), lambda _: None, searches_s=SHORT, wait_s=60.0)
        later.join()
    assert findings[0] == Finding("port", True, f"{link} opened")
    assert findings[1].text.startswith("1 (XM430-W350, ")


def test_a_port_unplugged_during_the_search_is_a_red_row() -> None:
    with Served(servo(1)) as served:
        path = served.path

        def unplug(step: str) -> None:
            if step == "motors at 115200 baud":
                served.pull.set()

        findings = port_checks.examine(path, unplug, searches_s=SHORT)
    assert findings[1:] == [
        Finding(
            "motors",
            False,
            f"{path} is gone; the motors hold where they are, by their own watchdog",
            "plug it in, and give a port that the row serial lists",
        )
    ]


# ---- setting up


@pytest.mark.parametrize(
    ("ids", "text"),
    [((), "0 motors where"), ((4,), "1 motors (4) where"), ((1, 2, 9), "3 motors (1, 2, 9) where")],
)
def test_only_two_motors_are_set_up(ids: tuple[int, ...], text: str) -> None:
    motors = [dataclasses.replace(GOOD, id=device) for device in ids]
    assert set_up(CLOSED, *motors) == Finding(
        "set-up",
        False,
        f"{text} a bench has two, so nothing was set up",
        "connect only those two, check that both answer, then run this again",
    )


def test_a_motor_of_another_kind_is_not_set_up() -> None:
    assert set_up(CLOSED, GOOD, dataclasses.replace(GOOD, id=2, model=1200)) == Finding(
        "set-up",
        False,
        "motor 2 is not usable, so nothing was set up: XL330-M288: its indirect data are "
        "elsewhere, and its current is in 1 mA",
        "use X series of the size 430 or 540 that measure their current, such as XM430-W350",
    )


def test_a_refused_set_up_writes_nothing() -> None:
    with Served(servo(5)) as served, opened(served.path) as line:
        motor = motor_checks.read(line, 5, 1_000_000)
        assert not set_up(line, motor).ok
        assert served.bus.asked == {Instruction.PING, Instruction.READ}
    assert not bench_file.DEFAULT_FILE.exists()


def test_only_the_leftovers_of_a_killed_program_are_repaired() -> None:
    servos = servo(1), servo(3)
    for s in servos:
        s.write(reg.RETURN_DELAY.address, b"\x00")
        s.write(reg.TORQUE_ENABLE.address, b"\x01")
        put(s, reg.WATCHDOG, reg.TRIPPED)
    servos[0].fail("overload")
    with Served(*servos) as served, opened(served.path) as line:
        motors = motor_checks.look(line, lambda _: None, SHORT)
        rows = motor_checks.judge(motors, served.path)
        assert red(rows) == ["hardware error", "watchdog", "torque", "bench"]
        assert set_up(line, *motors).text == (
            "1: kept; 3: kept; up_down 1 with its zero at 2048; left_right 3 with its zero at "
            "2048; wrote bench.toml"
        )
        motors = [motor_checks.read(line, motor.id, motor.baud) for motor in motors]
    assert red(motor_checks.judge(motors, served.path)) == []


def test_a_motor_that_does_not_return_after_a_reboot_is_an_error() -> None:
    servos = servo(1), servo(2)
    servos[1].reboot_s = 1e9
    with Served(*servos) as served, opened(served.path) as line:
        finding = set_up(line, GOOD, dataclasses.replace(GOOD, id=2))
    assert finding == Finding(
        "set-up",
        False,
        "motor 2 no longer answers at 1000000 baud",
        "switch the motors' supply off and on, then run this again",
    )
    assert not bench_file.DEFAULT_FILE.exists()


def test_set_up_needs_a_port_and_no_bench_file(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ConfigError, match=r"^--set-up goes with --port PORT; name the port"):
        examination.main(examination.Request(set_up=True))
    bench_file.DEFAULT_FILE.touch()
    text = (
        r"^bench\.toml exists, so nothing was set up; move it away to set up again, or omit "
        r"--set-up to check only$"
    )
    with pytest.raises(ConfigError, match=text):
        examination.main(examination.Request(port="nowhere", set_up=True))
    assert capsys.readouterr() == ("", "")


def test_set_up_needs_a_folder_to_write_to(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(ConfigError, match=r"^cannot write bench\.toml in .*; change to a folder"):
        examination.main(examination.Request(port="nowhere", set_up=True))
