"""What it means that a motor refuses a request, for people."""

from __future__ import annotations

from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.packets import Instruction, Refusal

_TABLE = "see its control table in hw/PROTOCOL.md"


def explained(kind: Instruction, parameters: bytes, error: int) -> tuple[str, str]:
    """Return what was refused and why, and what to do.

    Args:
        kind: the request.
        parameters: its parameters.
        error: error byte of the answer, without the alert.
    """
    address = int.from_bytes(parameters[:2], "little") if len(parameters) >= 2 else None
    what = {Instruction.READ: "read", Instruction.WRITE: "write"}.get(kind)
    if what is None or address is None:
        asked = f"to {kind.name.lower().replace('_', ' ')}"
    else:
        name = reg.NAMES.get(address)
        place = f"{name} (register {address})" if name else f"register {address}"
        data = parameters[2:]
        asked = f"to read {place}"
        if what == "write":
            value = int.from_bytes(data, "little", signed=len(data) > 1)
            asked = f"to write {value if len(data) <= 4 else data.hex(' ')} to {place}"
    why, step = _reason(what == "write", address, error)
    return f"refused {asked}: {why}", step


def _reason(writing: bool, address: int | None, error: int) -> tuple[str, str]:
    if error == Refusal.ACCESS:
        if writing and address is not None and reg.EEPROM_END > address >= reg.ID.address:
            return (
                "its torque is on, which locks the registers below 64",
                "switch its torque off first: end the program that drives it, or its supply",
            )
        if writing and address == reg.TORQUE_ENABLE.address:
            return (
                "a hardware error has shut it down",
                "switch its supply off and on, then run endolock doctor",
            )
        return "it has no such register, or it is read-only", _TABLE
    if error == Refusal.DATA_RANGE:
        goals = range(reg.GOAL_PWM.address, reg.TICK.address)
        if writing and address in goals:
            return (
                "the value is out of range, or its watchdog has stopped it",
                "reconnect, which clears its watchdog",
            )
        return "the register cannot hold this value", _TABLE
    if error == Refusal.DATA_LIMIT:
        return (
            "the value is beyond a limit set in the motor",
            "run endolock doctor --port PORT, which shows its limits",
        )
    if error == Refusal.DATA_LENGTH:
        return "the request has a wrong length", _TABLE
    if error == Refusal.INSTRUCTION:
        return "it does not know this instruction", "update its firmware with DYNAMIXEL Wizard"
    if error == Refusal.FAILED:
        return "it could not carry it out", "try again, then run endolock doctor"
    return f"error {error}", _TABLE
