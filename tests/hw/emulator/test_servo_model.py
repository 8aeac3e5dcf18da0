"""The device model: what an X-series servo does with its registers."""

from __future__ import annotations

from struct import pack

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.hw.one_servo import SETTLED_S, One

from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.packets import Refusal
from endolock.hw.dynamixel.registers import Register, Units
from endolock.hw.emulator.servo_model import CENTRE, Refused

POSITION_MODE = 3
KEPT = [
    reg.ID,
    reg.RETURN_DELAY,
    reg.DRIVE_MODE,
    reg.OPERATING_MODE,
    reg.HOMING_OFFSET,
    reg.CURRENT_LIMIT,
    reg.MAX_POSITION,
    reg.MIN_POSITION,
    reg.SHUTDOWN,
]
"""In the EEPROM."""
READ_ONLY = [
    reg.MODEL,
    reg.FIRMWARE,
    reg.REGISTERED,
    reg.HARDWARE_ERROR,
    reg.TICK,
    reg.CURRENT,
    reg.VELOCITY,
    reg.POSITION,
    reg.VOLTAGE,
    reg.TEMPERATURE,
]


@pytest.fixture
def one() -> One:
    """Unpack a servo."""
    return One()


# As it comes.


@pytest.mark.parametrize("angle_rad", [0.0, 0.3104, -17.0])
def test_at_any_angle_a_servo_starts_at_its_centre_with_torque_off(angle_rad: float) -> None:
    one = One(angle_rad)
    assert (one.get(reg.POSITION), one.get(reg.GOAL_POSITION)) == (CENTRE, CENTRE)
    assert one.get(reg.TORQUE_ENABLE) == 0
    assert not one.motor.on


def test_the_firmware_supports_the_watchdog(one: One) -> None:
    assert one.get(reg.FIRMWARE) >= reg.OLDEST_FIRMWARE
    assert one.get(reg.WATCHDOG) == 0


def test_it_measures_in_whole_steps(one: One) -> None:
    units = Units()
    one.turning(CENTRE + 1000)
    one.motor.load_a = -0.5
    one.wait(0.02)
    assert one.get(reg.CURRENT) == round(-0.5 / units.current_a)
    angle, speed, _ = one.motor.measure()
    assert one.get(reg.VELOCITY) == round(speed / units.velocity_rad_s)
    start = round(0.3104 / units.position_rad)
    assert one.get(reg.POSITION) == CENTRE + round(angle / units.position_rad) - start


def test_the_device_tick_counts_milliseconds_and_wraps(one: One) -> None:
    one.wait(1.2344)
    assert one.get(reg.TICK) == 1234
    one.clock.sleep_until(1e-3 * (reg.TICK_PERIOD + 5))
    assert one.get(reg.TICK) == 5


# What it refuses.


@pytest.mark.parametrize("register", KEPT)
def test_the_eeprom_is_locked_while_torque_is_on(one: One, register: Register) -> None:
    before = one.get(register)
    one.put(reg.TORQUE_ENABLE, 1)
    assert one.refusal(register, 4) is Refusal.ACCESS
    assert one.get(register) == before
    one.put(reg.TORQUE_ENABLE, 0)
    assert one.refusal(register, 4) is None
    assert one.get(register) == 4


def test_ram_is_not_locked(one: One) -> None:
    one.put(reg.TORQUE_ENABLE, 1)
    for register in (reg.STATUS_LEVEL, reg.POSITION_P, reg.WATCHDOG, reg.GOAL_CURRENT):
        assert one.refusal(register, 1) is None
        assert one.get(register) == 1


@pytest.mark.parametrize("register", READ_ONLY)
def test_measured_registers_are_read_only(one: One, register: Register) -> None:
    before = one.get(register)
    assert one.refusal(register, 77) is Refusal.ACCESS
    assert one.get(register) == before


def test_a_write_beyond_the_table_writes_nothing(one: One) -> None:
    with pytest.raises(Refused, match=r"^access$"):
        one.servo.write(reg.GOAL_POSITION.address, pack("<iH", 3000, 7))
    assert one.get(reg.GOAL_POSITION) == CENTRE


@pytest.mark.parametrize(
    ("register", "value"),
    [
        (reg.BAUD, len(reg.BAUDS)),
        (reg.OPERATING_MODE, 17),
        (reg.TORQUE_ENABLE, 2),
        (reg.WATCHDOG, 128),
        (reg.WATCHDOG, reg.TRIPPED),
        (reg.GOAL_POSITION, reg.LARGEST_GOAL + 1),
        (reg.GOAL_POSITION, -reg.LARGEST_GOAL - 1),
    ],
)
def test_a_value_that_a_register_cannot_hold_is_refused(
    one: One, register: Register, value: int
) -> None:
    one.put(reg.OPERATING_MODE, reg.EXTENDED_POSITION)
    before = one.get(register)
    assert one.refusal(register, value) is Refusal.DATA_RANGE
    assert one.get(register) == before


def test_in_position_mode_a_goal_lies_within_the_limits(one: One) -> None:
    one.put(reg.MIN_POSITION, 100)
    one.put(reg.MAX_POSITION, 3000)
    assert one.get(reg.OPERATING_MODE) == POSITION_MODE
    assert one.refusal(reg.GOAL_POSITION, 99) is Refusal.DATA_LIMIT
    assert one.refusal(reg.GOAL_POSITION, 3001) is Refusal.DATA_LIMIT
    assert one.refusal(reg.GOAL_POSITION, 100) is None
    assert one.refusal(reg.GOAL_POSITION, 3000) is None
    one.put(reg.OPERATING_MODE, reg.EXTENDED_POSITION)
    assert one.refusal(reg.GOAL_POSITION, 3001) is None
    assert one.refusal(reg.GOAL_POSITION, -reg.LARGEST_GOAL) is None


@pytest.mark.parametrize("register", [reg.GOAL_POSITION, reg.HOMING_OFFSET])
def test_half_a_register_is_refused(one: One, register: Register) -> None:
    for address, size in ((0, 2), (1, 3), (2, 2), (3, 1)):
        with pytest.raises(Refused, match=r"^data length$"):
            one.servo.write(register.address + address, b"\x01" * size)
    assert one.get(reg.POSITION) == one.get(reg.GOAL_POSITION) == CENTRE


def test_addresses_beyond_the_control_table_are_refused(one: One) -> None:
    assert len(one.servo.read(reg.END - 4, 4)) == 4
    with pytest.raises(Refused, match=r"^access$"):
        one.servo.read(reg.END - 4, 5)
    with pytest.raises(Refused, match=r"^access$"):
        one.servo.write(reg.END - 4, bytes(5))


def test_several_registers_can_be_written_at_once(one: One) -> None:
    one.put(reg.TORQUE_ENABLE, 1)
    one.servo.write(reg.PROFILE.address, pack("<iii", 0, 0, 2200))
    one.wait(SETTLED_S)
    assert one.get(reg.POSITION) == 2200


# Torque.


def test_with_torque_a_servo_moves_to_its_goal_over_several_turns(one: One) -> None:
    for goal in (CENTRE + 5 * reg.TURN + 7, -3 * reg.TURN - 11):
        one.put(reg.TORQUE_ENABLE, 0)
        one.turning(goal)
        one.wait(SETTLED_S)
        assert one.get(reg.POSITION) == goal


def test_without_torque_a_servo_stays_and_stores_the_goal(one: One) -> None:
    one.put(reg.GOAL_POSITION, 2500)
    one.wait(SETTLED_S)
    assert (one.get(reg.POSITION), one.get(reg.GOAL_POSITION)) == (CENTRE, 2500)
    one.put(reg.TORQUE_ENABLE, 1)
    one.wait(SETTLED_S)
    assert one.get(reg.POSITION) == 2500


def test_a_homing_offset_is_added_to_the_position(one: One) -> None:
    one.put(reg.HOMING_OFFSET, -300)
    assert one.get(reg.POSITION) == CENTRE - 300
    one.put(reg.HOMING_OFFSET, 0)
    assert one.get(reg.POSITION) == CENTRE


def test_changing_the_mode_clears_whole_turns(one: One) -> None:
    one.turning(CENTRE + 3 * reg.TURN + 40)
    one.wait(SETTLED_S)
    one.put(reg.TORQUE_ENABLE, 0)
    one.put(reg.OPERATING_MODE, POSITION_MODE)
    assert one.get(reg.POSITION) == CENTRE + 40


# Indirect data.


@given(
    st.lists(st.integers(0, reg.INDIRECT_DATA.address - 1), min_size=28, max_size=28),
    st.integers(0, 27),
    st.integers(1, 28),
)
def test_indirect_data_are_the_registers_they_point_to(
    addresses: list[int], first: int, size: int
) -> None:
    one = One().turning()
    one.wait(0.02)  # on its way, so that nothing measured is zero
    one.servo.write(reg.INDIRECT_ADDRESS.address, pack("<28H", *addresses))
    size = min(size, 28 - first)
    gathered = b"".join(one.servo.read(a, 1) for a in addresses[first : first + size])
    assert one.servo.read(reg.INDIRECT_DATA.address + first, size) == gathered


def test_the_register_block_is_read_in_one_transaction(one: One) -> None:
    one.servo.write(reg.INDIRECT_ADDRESS.address, pack("<19H", *reg.BLOCK_ADDRESSES))
    one.turning()
    one.put(reg.WATCHDOG, 20)
    one.wait(0.02)
    one.servo.fail("voltage")
    block = reg.unpack(one.servo.read(reg.INDIRECT_DATA.address, reg.BLOCK_SIZE))
    assert block == tuple(one.get(register) for register in reg.BLOCK)
    assert block.watchdog == 20
    assert block.velocity > 0


def test_indirect_addresses_count_from_when_they_are_written(one: One) -> None:
    for register in (reg.MODEL, reg.GOAL_POSITION, reg.MODEL):
        one.put(Register(reg.INDIRECT_ADDRESS.address, 2), register.address)
        one.put(Register(reg.INDIRECT_ADDRESS.address + 2, 2), register.address + 1)
        assert one.servo.read(reg.INDIRECT_DATA.address, 2) == one.servo.read(register.address, 2)


def test_indirect_data_from_beyond_the_table_are_refused(one: One) -> None:
    one.put(Register(reg.INDIRECT_ADDRESS.address, 2), reg.END)
    with pytest.raises(Refused, match=r"^access$"):
        one.servo.read(reg.INDIRECT_DATA.address, 1)


# What another program may leave.


def test_reversed_positions_speeds_and_goals_have_the_other_sign(one: One) -> None:
    one.turning(CENTRE + 100)
    one.wait(SETTLED_S)
    one.put(reg.TORQUE_ENABLE, 0)
    at = one.motor.measure()[0]
    one.put(reg.DRIVE_MODE, 1)
    assert one.get(reg.POSITION) == -CENTRE - 100
    one.put(reg.TORQUE_ENABLE, 1)
    one.put(reg.GOAL_POSITION, -CENTRE)
    one.wait(0.02)
    assert one.get(reg.VELOCITY) > 0
    one.wait(SETTLED_S)
    assert one.motor.measure()[0] == pytest.approx(at - 100 * Units().position_rad)
    one.put(reg.TORQUE_ENABLE, 0)
    one.put(reg.DRIVE_MODE, 0)
    assert one.get(reg.POSITION) == CENTRE


def test_a_goal_can_switch_torque_on(one: One) -> None:
    one.put(reg.DRIVE_MODE, 8)
    one.put(reg.GOAL_POSITION, CENTRE + 50)
    one.wait(SETTLED_S)
    assert (one.get(reg.TORQUE_ENABLE), one.get(reg.POSITION)) == (1, CENTRE + 50)


def test_a_startup_configuration_switches_torque_on_and_restores_what_was_set(one: One) -> None:
    one.put(reg.STARTUP, 3)
    one.put(reg.POSITION_P, 123)
    one.put(Register(reg.INDIRECT_ADDRESS.address, 2), reg.TICK.address)
    one.put(reg.WATCHDOG, 20)
    one.servo.reboot()
    assert (one.get(reg.TORQUE_ENABLE), one.motor.on) == (1, True)
    assert one.get(reg.POSITION_P) == 123
    assert one.get(Register(reg.INDIRECT_ADDRESS.address, 2)) == reg.TICK.address
    assert one.get(reg.WATCHDOG) == 0
    one.put(reg.TORQUE_ENABLE, 0)
    one.put(reg.STARTUP, 0)
    one.servo.reboot()
    assert (one.get(reg.TORQUE_ENABLE), one.get(reg.POSITION_P)) == (0, 800)


@pytest.mark.parametrize("register", [reg.POSITION_P, reg.GOAL_PWM, reg.GOAL_CURRENT])
def test_without_gain_power_or_current_a_motor_does_not_move(one: One, register: Register) -> None:
    one.put(reg.OPERATING_MODE, reg.CURRENT_POSITION)
    usual = one.get(register)
    one.put(register, 0)
    one.put(reg.TORQUE_ENABLE, 1)
    one.put(reg.GOAL_POSITION, CENTRE + 100)
    one.wait(SETTLED_S)
    assert one.get(reg.POSITION) == CENTRE
    one.put(register, usual)
    one.wait(SETTLED_S)
    assert one.get(reg.POSITION) == CENTRE + 100


def test_goals_of_current_and_power_lie_within_their_limits(one: One) -> None:
    for goal, limit in ((reg.GOAL_PWM, reg.PWM_LIMIT), (reg.GOAL_CURRENT, reg.CURRENT_LIMIT)):
        one.put(limit, 300)
        assert one.refusal(goal, 301) is Refusal.DATA_LIMIT
        assert one.refusal(goal, -300) is None
    assert one.refusal(reg.CURRENT_LIMIT, 1194) is Refusal.DATA_RANGE


def test_a_change_of_the_mode_resets_gains_and_goals(one: One) -> None:
    for register, value in ((reg.POSITION_P, 3), (reg.POSITION_I, 4), (reg.GOAL_PWM, 5)):
        one.put(register, value)
    one.put(reg.OPERATING_MODE, reg.EXTENDED_POSITION)
    gains = [one.get(register) for register in (reg.POSITION_P, reg.POSITION_I, reg.GOAL_PWM)]
    assert gains == [800, 0, reg.FULL_PWM]
