"""Values of registers: signed or unsigned, never wrapped around."""

import pytest
from tests.hw.emulated import Emulated

from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.registers import Register
from endolock.hw.emulator.direct_link import DirectLink

SIZES = (1, 2, 4)


@pytest.mark.parametrize("size", SIZES)
def test_a_signed_value_is_read_back_as_written(size: int) -> None:
    register, end = Register(0, size), 1 << 8 * size - 1
    for value in (-end, -1, 0, 1, end - 1):
        assert register.decode(register.encode(value)) == value
        assert register.encode_signed(value) == register.encode(value)
    assert register.encode(2 * end - 1) == register.encode(-1)


@pytest.mark.parametrize("size", SIZES)
def test_a_value_out_of_range_is_refused(size: int) -> None:
    register, end = Register(0, size), 1 << 8 * size - 1
    for value in (-end - 1, 2 * end):
        with pytest.raises(OverflowError):
            register.encode(value)
    for value in (-end - 1, end):
        with pytest.raises(OverflowError):
            register.encode_signed(value)


@pytest.mark.parametrize("direct", [False, True])
@pytest.mark.parametrize("goal", [1 << 31, -(1 << 31) - 1])
def test_a_goal_out_of_range_does_not_reach_a_motor(goal: int, direct: bool) -> None:
    bench = Emulated()
    link = DirectLink(bench.servos, bench.clock) if direct else bench.bus
    bench.guard.connect()
    before = [bench.bus.read(n, reg.GOAL_POSITION) for n in (1, 2)]
    with pytest.raises(OverflowError):
        link.cycle((goal, goal), lambda *_: True)
    assert [bench.bus.read(n, reg.GOAL_POSITION) for n in (1, 2)] == before
