"""How `endolock doctor --set-up` prepares two motors for a bench, and writes its bench.toml."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from endolock.hw.api import AXES, ConfigError, EndolockError, LinkError, LinkLost
from endolock.hw.bench import bench_file
from endolock.hw.bench.bench_file import Bench, Handles
from endolock.hw.bench.wall_clock import WallClock
from endolock.hw.dynamixel import models
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.port import DEFAULT_BAUD, Port
from endolock.hw.dynamixel.servo_bus import Bus
from endolock.hw.dynamixel.servo_setup import RESTART_S
from endolock.hw.dynamixel.settings import SETTINGS, Wish
from endolock.scripts.commands.doctor.finding import Finding
from endolock.scripts.commands.doctor.found_motor import FoundMotor
from endolock.scripts.commands.doctor.motor_checks import ANSWER_S, refused

WARNING = (
    "set-up: the motors relax and restart, and their present positions become their zeros: the "
    "endoscope must be straight now; Ctrl-C if it is not"
)


def check() -> None:
    """Check that a bench file can be written here.

    Raises:
        ConfigError: it cannot, or there is one.
    """
    path = bench_file.DEFAULT_FILE
    if path.exists():
        raise ConfigError(
            f"{path} exists, so nothing was set up",
            "move it away to set up again, or omit --set-up to check only",
        )
    if not os.access(Path(), os.W_OK | os.X_OK):
        raise ConfigError(
            f"cannot write {path} in {Path().resolve()}, so nothing was set up",
            "change to a folder that you may write to",
        )


def set_up(line: Port, motors: Sequence[FoundMotor]) -> Finding:
    """Set two motors up and write bench.toml; the one with the lower id gets up_down.

    Torque goes off. The EEPROM is written only where it differs: its write cycles are limited. A
    motor counts whole turns only while it has power, so both restart before their position is
    read: it is then in the turn in which every later start begins.

    Args:
        line: an open port.
        motors: all motors on it.
    """
    try:
        _accept(motors)
        bus = Bus(line, WallClock(), {}, ANSWER_S)
        for motor in motors:  # off first, both of them
            line.set_baud(motor.baud)
            bus.write(motor.id, reg.STATUS_LEVEL, 2)
            bus.write(motor.id, reg.WATCHDOG, 0)
            bus.write(motor.id, reg.TORQUE_ENABLE, 0)
        done = [f"{motor.id}: {', '.join(_write(bus, motor)) or 'kept'}" for motor in motors]
        for motor in motors:
            bus.reboot(motor.id)
        for motor in motors:
            _await(bus, motor.id)
        zeros = [bus.read(motor.id, reg.POSITION) for motor in motors]
        handles = {
            axis: Handle(id=motor.id, zero_counts=zero)
            for axis, motor, zero in zip(AXES, motors, zeros, strict=True)
        }
        bench_file.save(
            Bench(baud=DEFAULT_BAUD, handle=Handles(**handles)), bench_file.DEFAULT_FILE
        )
    except EndolockError as error:
        return refused("set-up", error)
    done += [f"{axis} {h.id} with its zero at {h.zero_counts}" for axis, h in handles.items()]
    return Finding("set-up", True, f"{'; '.join(done)}; wrote {bench_file.DEFAULT_FILE}")


def _accept(motors: Sequence[FoundMotor]) -> None:
    """Check that these are two motors whose registers are known.

    Raises:
        ConfigError: they are not.
    """
    if len(motors) != 2:
        ids = f" ({', '.join(str(motor.id) for motor in motors)})" if motors else ""
        raise ConfigError(
            f"{len(motors)} motors{ids} where a bench has two, so nothing was set up",
            "connect only those two, check that both answer, then run this again",
        )
    for motor in motors:
        if motor.known is None:
            raise ConfigError(
                f"motor {motor.id} is not usable, so nothing was set up: "
                f"{models.described(motor.model)}",
                models.FIT,
            )


def _write(bus: Bus, motor: FoundMotor) -> list[str]:
    """Write the settings that differ to a motor without torque; return the changes."""
    bus.port.set_baud(motor.baud)
    assert motor.known is not None  # see `_accept`
    wish = Wish(handle=Handle(id=motor.id), model=motor.known, units=motor.known.units)
    changes = []
    for setting in SETTINGS:
        wanted = setting.wanted(wish)
        if not setting.doctor or wanted is None or motor.firmware < setting.since:
            continue
        value = setting.value(bus.read(motor.id, setting.register))
        if setting.differs(value, wish):
            bus.write(motor.id, setting.register, setting.register.encode(wanted))
            changes.append(f"{setting.name} {value} -> {wanted}")
    if motor.baud != DEFAULT_BAUD:
        with suppress(LinkLost):  # it may answer at the new rate already
            bus.write(motor.id, reg.BAUD, reg.BAUDS.index(DEFAULT_BAUD))
        bus.port.set_baud(DEFAULT_BAUD)
        _await(bus, motor.id)
        changes.append(f"baud {motor.baud} -> {DEFAULT_BAUD}")
    return changes


def _await(bus: Bus, device: int) -> None:
    """Wait until a motor answers.

    Raises:
        LinkError: it does not.
    """
    clock = WallClock()
    while True:
        try:
            bus.ping(device)
            return
        except LinkLost:
            if clock.now() >= RESTART_S:
                raise LinkError(
                    f"motor {device} no longer answers at {DEFAULT_BAUD} baud",
                    "switch the motors' supply off and on, then run this again",
                    t=clock.now(),
                ) from None
