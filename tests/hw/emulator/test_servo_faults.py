"""When an X-series servo stops: watchdog, hardware errors, restarts."""

from __future__ import annotations

from math import inf
from struct import pack

import pytest
from tests.hw.one_servo import SETTLED_S, One

from endolock.hw.api import Fault
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.packets import Refusal
from endolock.hw.dynamixel.registers import Register, Units
from endolock.hw.emulator.servo_model import CENTRE, OVERLOAD_A, OVERLOAD_S, Refused

OTHER_GOALS = [Register(100, 2), reg.GOAL_CURRENT, Register(104, 4)]
"""Of PWM, current and velocity."""


@pytest.fixture
def one() -> One:
    """Unpack a servo."""
    return One()


# The watchdog.


def test_the_watchdog_counts_in_units_of_20_ms(one: One) -> None:
    one.turning()
    one.put(reg.WATCHDOG, 10)
    assert one.servo.trips_at == pytest.approx(one.clock.now() + 0.200, abs=1e-9)  # rounding
    one.wait(0.198)
    assert one.get(reg.WATCHDOG) == 10  # asking is enough
    one.wait(0.198)
    assert one.get(reg.WATCHDOG) == 10
    one.wait(0.202)
    assert one.get(reg.WATCHDOG) == reg.TRIPPED


def test_the_watchdog_is_off_by_default(one: One) -> None:
    one.turning()
    assert one.servo.trips_at == inf
    one.wait(10.0)
    assert one.get(reg.WATCHDOG) == 0


def test_the_watchdog_is_inactive_while_torque_is_off(one: One) -> None:
    one.put(reg.WATCHDOG, 1)
    one.wait(10.0)
    assert one.get(reg.WATCHDOG) == 1
    one.wait(10.0)
    one.put(reg.TORQUE_ENABLE, 1)
    assert one.get(reg.WATCHDOG) == 1  # the time before does not count


def test_a_trip_holds_torque_where_the_motor_is(one: One) -> None:
    one.turning()
    one.put(reg.WATCHDOG, 1)
    one.wait(0.030)
    there = one.get(reg.POSITION)
    assert CENTRE + 100 < there < CENTRE + 4 * reg.TURN - 100  # on its way
    one.wait(SETTLED_S)
    assert one.get(reg.POSITION) == pytest.approx(there, abs=1)  # held to one step
    assert one.get(reg.TORQUE_ENABLE) == 1
    assert one.motor.on


def test_after_a_trip_goals_are_refused_until_the_watchdog_is_written_0(one: One) -> None:
    one.turning()
    one.put(reg.WATCHDOG, 1)
    one.wait(0.030)
    for register in (reg.GOAL_POSITION, *OTHER_GOALS):
        assert one.refusal(register, 1) is Refusal.DATA_RANGE
    assert one.refusal(reg.POSITION_P, 1) is None
    one.put(reg.WATCHDOG, 0)
    for register in (*OTHER_GOALS, reg.GOAL_POSITION):
        assert one.refusal(register, 1) is None
    one.wait(SETTLED_S)
    assert one.get(reg.POSITION) == 1


# Hardware errors.


@pytest.mark.parametrize(
    ("kind", "bit", "stops"),
    [
        ("overload", 0x20, True),
        ("overheat", 0x04, True),
        ("voltage", 0x01, False),
        ("encoder", 0x08, False),
    ],
)
def test_an_error_is_latched_and_some_switch_torque_off(
    one: One, kind: Fault, bit: int, stops: bool
) -> None:
    one.turning()
    assert not one.servo.alert
    one.servo.fail(kind)
    assert one.servo.alert
    assert one.get(reg.HARDWARE_ERROR) == bit
    assert one.get(reg.TORQUE_ENABLE) == (not stops)
    assert one.motor.on is not stops
    one.wait(SETTLED_S)
    assert one.get(reg.HARDWARE_ERROR) == bit


def test_after_a_shutdown_torque_is_refused_until_a_reboot(one: One) -> None:
    one.turning()
    one.servo.fail("overload")
    for _ in range(2):
        assert one.refusal(reg.TORQUE_ENABLE, 1) is Refusal.ACCESS
        assert not one.motor.on
        assert one.refusal(reg.TORQUE_ENABLE, 0) is None
    one.servo.reboot()
    assert not one.servo.alert
    assert one.refusal(reg.TORQUE_ENABLE, 1) is None
    assert one.motor.on


def test_errors_add_up(one: One) -> None:
    one.servo.fail("voltage")
    one.servo.fail("overheat")
    assert one.get(reg.HARDWARE_ERROR) == 0x05


def test_which_errors_switch_torque_off_can_be_chosen(one: One) -> None:
    one.put(reg.SHUTDOWN, 0x01)
    one.turning()
    one.servo.fail("overload")
    assert one.motor.on
    one.servo.fail("voltage")
    assert not one.motor.on


def test_only_known_hardware_errors_can_be_latched(one: One) -> None:
    with pytest.raises(ValueError, match=r"^watchdog is not a hardware error$"):
        one.servo.fail("watchdog")


def test_a_high_current_for_long_is_an_overload(one: One) -> None:
    one.turning()
    for load_a, seconds in ((1.1 * OVERLOAD_A, 0.9 * OVERLOAD_S), (0.9 * OVERLOAD_A, 5.0)):
        one.motor.load_a = load_a
        for _ in range(round(seconds / 0.1)):
            one.wait(0.1)
            assert one.get(reg.HARDWARE_ERROR) == 0
    one.motor.load_a = -1.1 * OVERLOAD_A
    assert one.get(reg.HARDWARE_ERROR) == 0  # what was before does not count
    one.wait(1.1 * OVERLOAD_S)
    one.get(reg.CURRENT)
    assert one.get(reg.HARDWARE_ERROR) == 0x20
    assert not one.motor.on


# A reboot.


def test_a_reboot_clears_ram_and_keeps_the_eeprom(one: One) -> None:
    one.put(reg.RETURN_DELAY, 0)
    one.put(reg.INDIRECT_ADDRESS, int.from_bytes(pack("<H", reg.POSITION.address) * 28, "little"))
    one.put(reg.STATUS_LEVEL, 1)
    one.turning(3000)
    one.put(reg.WATCHDOG, 20)
    one.wait(0.1)
    forgotten = [reg.WATCHDOG, reg.STATUS_LEVEL, reg.TORQUE_ENABLE]
    forgotten += [reg.INDIRECT_ADDRESS, reg.INDIRECT_DATA]
    fresh = One()
    for register in forgotten:
        assert one.get(register) != fresh.get(register)
    one.servo.reboot()
    for register in forgotten:
        assert one.get(register) == fresh.get(register)
    assert one.get(reg.OPERATING_MODE) == reg.EXTENDED_POSITION
    assert one.get(reg.RETURN_DELAY) == 0
    assert one.get(reg.TICK) == 0
    assert not one.motor.on


@pytest.mark.parametrize("turns", [5, -5])
def test_a_reboot_clears_whole_turns_and_moves_nothing(one: One, turns: int) -> None:
    one.turning(CENTRE + turns * reg.TURN + 40)
    one.wait(SETTLED_S)
    before, *_ = one.motor.measure()
    one.servo.reboot()
    assert one.get(reg.POSITION) == one.get(reg.GOAL_POSITION) == CENTRE + 40
    one.put(reg.TORQUE_ENABLE, 1)
    one.wait(SETTLED_S)
    step_rad = Units().position_rad
    assert one.motor.measure()[0] == pytest.approx(before, abs=step_rad)  # rounded to a step


def test_after_a_reboot_a_servo_answers_only_after_a_delay() -> None:
    one = One(reboot_s=0.3)
    assert one.servo.awake
    one.servo.reboot()
    one.wait(0.298)
    assert not one.servo.awake
    one.wait(0.004)
    assert one.servo.awake
    assert one.get(reg.TICK) <= 2


def test_registered_writes_wait_for_the_action(one: One) -> None:
    one.servo.register(reg.GOAL_POSITION.address, pack("<i", 2222))
    assert (one.get(reg.GOAL_POSITION), one.get(reg.REGISTERED)) == (CENTRE, 1)
    one.servo.act()
    assert (one.get(reg.GOAL_POSITION), one.get(reg.REGISTERED)) == (2222, 0)
    with pytest.raises(Refused, match=r"^instruction$"):
        one.servo.act()
    one.servo.register(reg.GOAL_POSITION.address, pack("<i", 2223))
    one.servo.reboot()
    with pytest.raises(Refused, match=r"^instruction$"):
        one.servo.act()
