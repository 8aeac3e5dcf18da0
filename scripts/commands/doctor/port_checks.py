"""Checks of serial ports by `endolock doctor`, and of the one given with --port.

No other port is opened: another device may restart when its port is opened.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from endolock.hw.api import EndolockError, PortGone
from endolock.hw.bench.wall_clock import WallClock
from endolock.hw.dynamixel.port import BY_ID, DEFAULT_BAUD, Port, serial_port
from endolock.scripts.commands.doctor import motor_checks
from endolock.scripts.commands.doctor.finding import Finding
from endolock.scripts.commands.doctor.found_motor import FoundMotor
from endolock.scripts.commands.doctor.motor_checks import SEARCHES_S, Report, refused

TIMER_MS = 1
"""Shortest time for which an FTDI adapter buffers received bytes [ms]."""
WAIT_S = 20.0
"""A port that does not exist is waited for this long [s]: the emulator makes it when it is ready,
14 s after its start with five busy programs on every core."""
OTHER_PORT = "see the row 'serial', or give a port that it lists"
"""What to do where a port cannot be opened."""
UDEV_FILE = "/etc/udev/rules.d/99-endolock.rules"
UDEV_RULE = 'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"'


def serial(
    devices: Path = Path("/dev"), adapters: Path = Path("/sys/bus/usb-serial/devices")
) -> Finding:
    """List the serial ports on USB; check, without opening them, the permission to open them.

    Args:
        devices: their folder.
        adapters: folder in which Linux shows their settings.
    """
    found: dict[Path, str] = {}
    for pattern in ("serial/by-id/*", "ttyUSB*", "ttyACM*"):
        for link in sorted(devices.glob(pattern)):
            found.setdefault(link.resolve(), link.name)
    closed_to_us = {
        port.name: _group(port) for port in found if not os.access(port, os.R_OK | os.W_OK)
    }
    timers_ms: dict[str, int] = {}
    for port in found:
        with suppress(OSError, ValueError):  # only FTDI's have one
            timers_ms[port.name] = int((adapters / port.name / "latency_timer").read_text())
    return ports({port.name: name for port, name in found.items()}, closed_to_us, timers_ms)


def ports(
    found: Mapping[str, str], closed_to_us: Mapping[str, str], timers_ms: Mapping[str, int]
) -> Finding:
    """Judge serial ports.

    Args:
        found: their names for people, by device.
        closed_to_us: those that we may not open, with the group that may.
        timers_ms: time for which they buffer received bytes [ms], where it is known.
    """
    if not found:
        return Finding("serial", True, "none; the twin needs none")
    described, advice = [], []
    for port, name in found.items():
        more = [name] if name != port else []
        more += [f"latency timer {timers_ms[port]} ms"] if port in timers_ms else []
        described.append(f"{port} ({', '.join(more)})" if more else port)
    text = ", ".join(described)
    if closed_to_us:
        groups = ",".join(sorted(set(closed_to_us.values())))
        text += f"; no permission to open {', '.join(closed_to_us)}"
        advice.append(f"sudo usermod -aG {groups} $USER, then log in again")
    if late := [port for port, timer_ms in timers_ms.items() if timer_ms > TIMER_MS]:
        text += f"; the timer of {', '.join(late)} slows every cycle (16 ms: 58 cycles/s)"
        advice.append(
            f"write the line {UDEV_RULE} into {UDEV_FILE}, then sudo udevadm control --reload, "
            "and plug the adapter in again"
        )
    return Finding("serial", not advice, text, "; ".join(advice))


def examine(
    path: str,
    report: Report,
    *,
    change: Callable[[Port, list[FoundMotor]], Finding] | None = None,
    by_id: Path = BY_ID,
    searches_s: Sequence[float] = SEARCHES_S,
    wait_s: float = WAIT_S,
) -> list[Finding]:
    """Open a port, find the motors on it, and judge both.

    Args:
        path: path of the port.
        report: called with the name of each step.
        change: sets the motors up before they are judged.
        by_id: folder of persistent names.
        searches_s: see `SEARCHES_S`.
        wait_s: see `WAIT_S`.
    """
    findings: list[Finding] = []
    line: Port | None = None
    advice = ""
    try:
        line = serial_port(path, DEFAULT_BAUD)
        advice = OTHER_PORT
        _open(line, report, wait_s)
        advice = ""
        findings.append(Finding("port", True, _opened(path, by_id)))
        motors = motor_checks.look(line, report, searches_s)
        if change:
            report("set-up")
            findings.append(change(line, motors))
            motors = motor_checks.look(line, report, searches_s)
        findings += motor_checks.judge(motors, path)
    except EndolockError as error:
        findings.append(refused("motors" if findings else "port", error, advice))
    finally:
        if line:
            line.close()
    return findings


def _open(line: Port, report: Report, wait_s: float) -> None:
    """Open a port as soon as it exists."""
    clock = WallClock()
    while True:
        try:
            line.open()
            return
        except PortGone:
            if clock.now() >= wait_s:
                raise
        report(f"{line.name}, which is not there yet")
        clock.sleep_until(clock.now() + 0.1)


def _group(port: Path) -> str:
    """Return the group that may open a port; Windows has none."""
    if sys.platform == "win32":
        return ""
    return port.group()


def _opened(path: str, by_id: Path) -> str:
    """Say under which name a port was opened, and which one to prefer."""
    port = Path(path)
    persistent = sorted(link for link in by_id.glob("*") if link.resolve() == port.resolve())
    if not persistent or port.absolute() in persistent:
        return f"{path} opened"
    return f"{path} opened; prefer {persistent[0]}: it stays the same across USB ports"
