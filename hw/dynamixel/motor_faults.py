"""What a motor's block, or its silence, says about a fault, in words."""

from __future__ import annotations

from typing import NamedTuple

from endolock.hw.api import DeviceFault, HardwareError, LinkLost
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.registers import Block
from endolock.hw.errors import RESUME


class Who(NamedTuple):
    """A motor, and when something was found out about it."""

    device: int
    axis: str
    t: float
    """[s]"""

    def __str__(self) -> str:
        return f"handle motor {self.device} ({self.axis})"


def of_block(who: Who, block: Block, on: bool, watchdog_s: float) -> HardwareError | None:
    """Return the fault that a block reports, or None.

    Args:
        who: the motor.
        block: its registers.
        on: whether its torque was switched on.
        watchdog_s: time of its watchdog [s].
    """
    tripped = on and block.watchdog == reg.TRIPPED
    if not block.hardware_error and not tripped and bool(block.torque) == on:
        return None
    if block.hardware_error:
        known = [entry for bit, entry in reg.HARDWARE_ERRORS.items() if block.hardware_error & bit]
        unknown = f"hardware error {block.hardware_error:#04x}", "see its maker's manual"
        kind, what, first = known[0] if known else ("reset", *unknown)
        return DeviceFault(
            f"{who} stopped: {what}", first, kind=kind, recovery=RESUME, t=who.t, axis=who.axis
        )
    if tripped:
        return DeviceFault(
            f"{who} stopped by itself: it received no packet for {watchdog_s:g} s; it holds where "
            "it is",
            "find out what delayed the program",
            kind="watchdog",
            recovery=RESUME,
            t=who.t,
            axis=who.axis,
        )
    return still_on(who) if block.torque else None


def still_on(who: Who) -> LinkLost:
    """Return the error of a motor with torque that should have none."""
    return LinkLost(
        f"{who} has torque though it was switched off",
        "end any other program that drives it",
        recovery=("clear_fault",),
        t=who.t,
        axis=who.axis,
    )


def reset(who: Who, *, restarted: bool) -> DeviceFault:
    """Return the fault of a motor that lost its torque.

    Args:
        who: the motor.
        restarted: whether it has restarted; otherwise it was switched off.
    """
    what = "was switched off by another program"
    if restarted:
        what = "has restarted: its power was off for a moment, or it was rebooted"
    return DeviceFault(
        f"{who} {what}",
        "check plug and supply",
        kind="reset",
        recovery=RESUME,
        t=who.t,
        axis=who.axis,
    )


def unread(who: Who) -> LinkLost:
    """Return the error of a motor that answers, but to too few cycles or none."""
    return LinkLost(
        f"{who} does not answer to sync reads",
        "check its cable and power, then run endolock doctor",
        recovery=("connect",),
        t=who.t,
        axis=who.axis,
    )


def disagreeing(who: Who, counts: list[int]) -> DeviceFault:
    """Return the error of a motor whose position is not known.

    Args:
        who: the motor.
        counts: the positions read.
    """
    return DeviceFault(
        f"{who} reads {', '.join(map(str, counts))} counts in succession, so its position is not "
        "known",
        "hold its handle still, and check its encoder and firmware",
        kind="encoder",
        recovery=("clear_fault",),
        t=who.t,
        axis=who.axis,
    )
