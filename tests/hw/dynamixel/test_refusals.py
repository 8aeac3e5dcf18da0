"""What a motor's refusal says to people: the register, the reason and what to do."""

from __future__ import annotations

import pytest
from tests.hw.emulated import Emulated

from endolock.hw.api import HardwareError
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.packets import Instruction, Refusal
from endolock.hw.dynamixel.refusals import explained
from endolock.hw.dynamixel.registers import Register
from endolock.hw.emulator.direct_link import DirectLink


@pytest.mark.parametrize("direct", [False, True])
def test_a_locked_register_says_that_torque_is_on(direct: bool) -> None:
    bench = Emulated()
    bench.guard.connect()
    bench.guard.enable()
    link = DirectLink(bench.servos, bench.clock) if direct else bench.bus
    with pytest.raises(HardwareError) as caught:
        link.write(1, reg.ID, 2)
    who = "1" if direct else "1 (up_down)"
    assert str(caught.value) == (
        f"handle motor {who} refused to write 2 to ID (register 7): its torque is on, which locks "
        "the registers below 64; switch its torque off first: end the program that drives it, or "
        "its supply"
    )


@pytest.mark.parametrize(
    ("register", "value", "text"),
    [
        (reg.MODEL, 1, "it has no such register, or it is read-only"),
        (reg.WATCHDOG, 128, "the register cannot hold this value"),
        (reg.GOAL_CURRENT, 1194, "the value is beyond a limit set in the motor"),
        (Register(reg.GOAL_POSITION.address, 2), 1, "the request has a wrong length"),
    ],
)
def test_each_reason_is_told(register: Register, value: int, text: str) -> None:
    bench = Emulated()
    with pytest.raises(HardwareError) as caught:
        bench.bus.write(1, register, value)
    name = reg.NAMES[register.address]
    start = f"handle motor 1 (up_down) refused to write {value} to {name} (register "
    assert str(caught.value).startswith(start)
    assert f": {text}; " in str(caught.value)


def test_a_shut_down_motor_says_so() -> None:
    bench = Emulated()
    bench.servos[0].fail("overload")
    with pytest.raises(HardwareError, match="a hardware error has shut it down; switch its supply"):
        bench.bus.write(1, reg.TORQUE_ENABLE, 1)


@pytest.mark.parametrize("kind", [Instruction.READ, Instruction.WRITE, Instruction.REBOOT])
@pytest.mark.parametrize("error", [*Refusal, 8, 0x7F])
@pytest.mark.parametrize("parameters", [b"", b"\x07\x00", b"\x07\x00\x02", b"\xff\xff" + bytes(9)])
def test_every_refusal_has_a_reason_and_a_next_step(
    kind: Instruction, error: int, parameters: bytes
) -> None:
    what, step = explained(kind, parameters, error)
    assert what.startswith("refused to ")
    assert what.endswith(tuple("abcdefghijklmnopqrstuvwxyz0123456789"))
    assert step
