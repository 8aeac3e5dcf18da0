"""Checks of the motors on a serial port by `endolock doctor`; they move and change nothing."""

from __future__ import annotations

import shlex
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from endolock.hw.api import ConfigError, EndolockError, LinkLost, PortBusy, PortGone
from endolock.hw.bench import bench_file
from endolock.hw.bench.wall_clock import WallClock
from endolock.hw.dynamixel import models
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.packets import Instruction, Parser, encode
from endolock.hw.dynamixel.port import DEFAULT_BAUD, Port
from endolock.hw.dynamixel.servo_bus import Bus
from endolock.hw.dynamixel.servo_setup import read_settings
from endolock.hw.dynamixel.settings import STATUS_LEVEL
from endolock.scripts.commands.doctor import setting_checks
from endolock.scripts.commands.doctor.finding import Finding
from endolock.scripts.commands.doctor.found_motor import FoundMotor

SEARCHES_S = (0.15, 0.8)
"""Wait for answers at each baud rate [s]: the second one where the first found fewer than two
motors. They answer in turn, 3 ms for each id: enough for ids up to 40, and for all. Source of the
3 ms: time-out of the maker's library."""
ANSWER_S = 0.1
"""Time-out of one motor's answer [s]: 30 ms at 9600 baud, 16 ms in an adapter, and some more."""
Report = Callable[[str], None]
"""Called with the present step."""


def refused(name: str, error: EndolockError, advice: str = "") -> Finding:
    """Turn an error into a finding.

    Args:
        name: of the check.
        error: what went wrong.
        advice: what to do, where that is other than the error says.
    """
    if isinstance(error, PortGone):
        advice = "plug it in, and give a port that the row serial lists"
    elif isinstance(error, LinkLost):
        advice = "check power and cable, then run this again"
    elif isinstance(error, PortBusy):
        advice = f"{error.next_step}, then run this again"
    step = advice or error.next_step or "correct that, then run this again"
    return Finding(name, False, error.what, step)


def look(line: Port, report: Report, searches_s: Sequence[float] = SEARCHES_S) -> list[FoundMotor]:
    """Find all motors on an open port, at every baud rate, and read them.

    Raises:
        ConfigError: motors share an id.
        LinkError: a motor that was found no longer answers, or the port was unplugged.
    """
    addresses = _search(line, report, searches_s)
    times = Counter(device for device, _ in addresses)
    for device, baud in addresses:
        if times[device] > 1 or _crowded(line, device, baud):
            raise ConfigError(
                f"answers with the id {device} come twice or damaged: several motors have it, or "
                "the cable is bad",
                "connect one motor alone, give it another id (docs/bench.md), then connect both",
            )
    return sorted((read(line, *address) for address in addresses), key=lambda motor: motor.id)


def read(line: Port, device: int, baud: int) -> FoundMotor:
    """Read the registers of one motor that matter here.

    Raises:
        LinkError: it does not answer, or the port was unplugged.
    """
    line.set_baud(baud)
    bus = Bus(line, WallClock(), {}, ANSWER_S)
    model, firmware = bus.ping(device)
    found = FoundMotor(id=device, model=model, firmware=firmware, baud=baud)
    if found.known is None:
        return found
    try:
        kept, others = (read_settings(bus, device, firmware, kept=k) for k in (True, False))
    except LinkLost:
        bus.ping(device)  # one that answers to this has a low status return level
        return found
    return replace(
        found,
        hardware_error=bus.read(device, reg.HARDWARE_ERROR),
        watchdog=bus.read(device, reg.WATCHDOG),
        torque=bus.read(device, reg.TORQUE_ENABLE),
        settings=kept | others,
    )


def judge(motors: Sequence[FoundMotor], path: str) -> list[Finding]:
    """Judge the motors found on a port, one row per check."""
    if not motors:
        text = f"none answers at any rate from {reg.BAUDS[0]} to {reg.BAUDS[-1]} baud"
        advice = (
            "switch the motors' supply on and plug the data cable in; if two have the same id, as "
            "new ones have, connect one alone and give it another (docs/bench.md)"
        )
        return [Finding("motors", False, text, advice)]
    listed = [f"{m.id} ({m.name}, firmware {m.firmware}, {m.baud} baud)" for m in motors]
    strange = [models.described(m.model) for m in motors if m.known is None]
    advice = f"{', '.join(strange)}; {models.FIT}" if strange else ""
    away = "move bench.toml away, " if bench_file.DEFAULT_FILE.exists() else ""
    cure = (
        f"{away}straighten the endoscope, then endolock doctor --port {shlex.quote(path)} --set-up"
    )
    rows = [Finding("motors", not strange, ", ".join(listed), advice)]
    for check in CHECKS:
        bad = any(check.bad(m) for m in motors)
        values = ", ".join(f"{m.id}: {_said(check, m)}" for m in motors)
        advice = check.advice.replace("SET-UP", cure) if bad else ""
        rows.append(Finding(check.name, not bad, values, advice))
        if check is CHECKS[AFTER]:
            rows += setting_checks.judge(motors, cure)
    return [*rows, _bench(motors, cure)]


def _said(check: MotorCheck, motor: FoundMotor) -> str:
    return "unknown" if motor.mute and check.reads else check.value(motor)


class MotorCheck(NamedTuple):
    """One check of all motors."""

    name: str
    value: Callable[[FoundMotor], str]
    bad: Callable[[FoundMotor], bool]
    advice: str
    """What to do if a motor fails it."""
    reads: bool = False
    """Whether it reads a register, which a motor that answers to pings only does not return."""


def _errors(motor: FoundMotor) -> str:
    latched = [
        f"{what} ({kind}): {first}"
        for bit, (kind, what, first) in reg.HARDWARE_ERRORS.items()
        if motor.hardware_error & bit
    ]
    return ", ".join(latched) or (hex(motor.hardware_error) if motor.hardware_error else "none")


def _level(motor: FoundMotor) -> str:
    if motor.mute:
        return "0 (it answers to pings only)"
    return str(motor.settings.get(STATUS_LEVEL.name, "unknown"))


def _watchdog(motor: FoundMotor) -> str:
    if motor.watchdog == reg.TRIPPED:
        return "has stopped the motor"
    return f"{motor.watchdog * reg.WATCHDOG_UNIT_S:g} s" if motor.watchdog else "off"


CHECKS = (
    MotorCheck(
        "firmware",
        lambda m: str(m.firmware),
        lambda m: m.firmware < reg.OLDEST_FIRMWARE,
        f"below {reg.OLDEST_FIRMWARE} there is no bus watchdog: update it with the maker's "
        "DYNAMIXEL Wizard",
    ),
    MotorCheck(
        "baud",
        lambda m: str(m.baud),
        lambda m: m.baud < DEFAULT_BAUD,
        "this is slow, the factory setting of 57600 gives 55 cycles/s: SET-UP",
    ),
    MotorCheck(
        "status return level",
        _level,
        lambda m: m.mute or m.settings.get(STATUS_LEVEL.name, 2) != 2,
        "another program left it, and the motor does not answer to everything; the next program to "
        "connect sets it to 2, as does switching the supply off and on: then run this again",
    ),
    MotorCheck(
        "hardware error",
        _errors,
        lambda m: m.hardware_error != 0,
        "do that, then switch the motors' supply off and on",
        reads=True,
    ),
    MotorCheck(
        "watchdog",
        _watchdog,
        lambda m: m.watchdog == reg.TRIPPED,
        "its program stopped sending; the next program to connect relaxes the motor and clears "
        "this, as does switching the supply off: hold the endoscope",
        reads=True,
    ),
    MotorCheck(
        "torque",
        lambda m: "on" if m.torque else "off",
        lambda m: m.torque != 0,
        "it holds though no program has the port; the next program to connect relaxes the motor, "
        "as does switching the supply off: hold the endoscope",
        reads=True,
    ),
)
"""In the order of the rows."""
AFTER = 2
"""Index of the check after which the settings come."""


def _bench(motors: Sequence[FoundMotor], cure: str) -> Finding:
    """Check that the motors are those of the bench file here, or of the defaults."""
    name = (
        f"{bench_file.DEFAULT_FILE}:"
        if bench_file.DEFAULT_FILE.exists()
        else f"no {bench_file.DEFAULT_FILE} here, so"
    )
    try:
        bench = bench_file.load()
    except ConfigError as error:
        return refused("bench", error)
    there = {m.id: m.baud for m in motors}
    expected = {handle.id: axis for axis, handle in bench.handles.items()}
    ids = ", ".join(f"{axis} {device}" for device, axis in expected.items())
    text = f"{name} {ids} at {bench.baud} baud"
    missing = [f"{device} ({axis})" for device, axis in expected.items() if device not in there]
    if missing:
        answers = ", ".join(map(str, there))
        text += f"; motor {' and '.join(missing)} does not answer, but {answers}"
        return Finding("bench", False, text, f"check its supply and cable, or {cure}")
    if others := [f"{d} at {there[d]}" for d in expected if there[d] != bench.baud]:
        return Finding("bench", False, f"{text}; motor {' and '.join(others)}", cure)
    return Finding("bench", True, text)


def _search(line: Port, report: Report, searches_s: Sequence[float]) -> list[tuple[int, int]]:
    """Return id and baud rate of every motor that answers to a broadcast ping."""
    found: list[tuple[int, int]] = []
    for wait_s in searches_s:
        bus = Bus(line, WallClock(), {}, wait_s)
        found = []
        for baud in reg.BAUDS:
            report(f"motors at {baud} baud")
            line.set_baud(baud)
            found += [(device, baud) for device in bus.scan()]
        if len(found) >= 2:
            break
    return found


def _crowded(line: Port, device: int, baud: int) -> bool:
    """Return whether more than one motor answers to an id, one after another or at once."""
    line.set_baud(baud)
    line.receive(0.0)  # what may be left
    line.send(encode(device, Instruction.PING))
    parser, answers = Parser(), 0
    end = time.monotonic() + ANSWER_S
    while data := line.receive(end - time.monotonic()):
        answers += len(parser.feed(data))
    return answers > 1 or parser.damaged > 0
