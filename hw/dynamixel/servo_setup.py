"""Settings that a servo needs before cycles can start, written at connecting."""

from __future__ import annotations

from collections.abc import Sequence
from struct import pack
from typing import Protocol

from endolock.hw.api import Clock, LinkLost, StateError
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.registers import Register, Units
from endolock.hw.dynamixel.servo_bus import Accept, Cycle

RESTART_S = 1.0
"""Longest time until a motor answers again after a reboot [s]. Assumed: X series take 0.3 s."""


class Link(Protocol):
    """Access to the registers of motors: `Bus`, or `DirectLink`."""

    def open(self) -> None:
        """Open it."""

    def close(self) -> None:
        """Close it."""

    def ping(self, device: int) -> tuple[int, int]:
        """Return model number and firmware version."""

    def read(self, device: int, register: Register) -> int:
        """Read a register as a signed number."""

    def write(self, device: int, register: Register, value: int | bytes) -> None:
        """Write a register."""

    def reboot(self, device: int) -> None:
        """Restart a motor."""

    def cycle(self, goals: Sequence[int] | None, accept: Accept) -> Cycle:
        """Send all goals, read all blocks."""


def prepare(link: Link, clock: Clock, axis: str, handle: Handle, units: Units) -> None:
    """Set one motor up so that its blocks can be read; torque is off.

    Args:
        link: connects to it.
        clock: stamps errors.
        axis: the axis that it turns.
        handle: how it drives its wheel.
        units: units of its registers.

    Raises:
        StateError: it cannot be used as it is set.
        HardwareError: it refuses, or does not answer.
    """
    device = handle.id
    _, firmware = link.ping(device)
    if firmware < reg.OLDEST_FIRMWARE:
        raise StateError(
            f"handle motor {device} ({axis}) has firmware {firmware}, without a bus watchdog",
            f"update it to {reg.OLDEST_FIRMWARE} or newer",
            t=clock.now(),
            axis=axis,
        )
    if offset := link.read(device, reg.HOMING_OFFSET):
        raise StateError(
            f"handle motor {device} ({axis}) has a homing offset of {offset} counts, with which "
            "it would creep after its watchdog has stopped it",
            "set it to 0, and its zero again, with endolock doctor --port PORT --set-up",
            t=clock.now(),
            axis=axis,
        )
    mode = reg.EXTENDED_POSITION if handle.current_limit_a is None else reg.CURRENT_POSITION
    # Written only where it differs: the EEPROM has a limited number of write cycles.
    for register, value in (
        (reg.OPERATING_MODE, mode),
        (
            reg.DRIVE_MODE,
            0,
        ),  # not reversed, no time-based profile, torque never switched on by a goal
        (reg.RETURN_DELAY, 0),
    ):
        if link.read(device, register) != value:
            link.write(device, register, value)
    link.write(device, reg.STATUS_LEVEL, 2)
    link.write(device, reg.PROFILE, bytes(reg.PROFILE.size))
    if handle.current_limit_a is not None:
        link.write(device, reg.GOAL_CURRENT, round(handle.current_limit_a / units.current_a))
    gathered = pack(f"<{reg.BLOCK_SIZE}H", *reg.BLOCK_ADDRESSES)
    link.write(device, reg.INDIRECT_ADDRESS, gathered)


def await_restart(link: Link, clock: Clock, axis: str, device: int) -> None:
    """Wait until a motor answers again after a reboot.

    Raises:
        LinkLost: it does not within `RESTART_S`.
    """
    end = clock.now() + RESTART_S
    while True:
        try:
            link.ping(device)
            return
        except LinkLost as error:
            if clock.now() >= end:
                raise LinkLost(
                    f"handle motor {device} ({axis}) does not answer after its restart",
                    "check its power",
                    recovery=("clear_fault",),
                    t=clock.now(),
                    axis=axis,
                ) from error
            clock.sleep_until(clock.now() + 0.05)
