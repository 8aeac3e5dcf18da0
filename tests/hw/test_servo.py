"""The device model: what an X-series servo does with its registers, in time moved by hand."""

from __future__ import annotations

from math import inf
from struct import pack

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.hw.emulated import BenchClock, LagMotor

from endolock.hw import registers as reg
from endolock.hw.api import Fault
from endolock.hw.packets import Refusal
from endolock.hw.registers import Register, Units
from endolock.hw.servo import OVERLOAD_A, OVERLOAD_S, Refused, Servo

CENTRE = 2048
SETTLED_S = 1.0  # forty lags of the motor: nothing is left of a step
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
OTHER_GOALS = [Register(100, 2), reg.GOAL_CURRENT, Register(104, 4)]
"""Of PWM, current and velocity."""


class One:
    """A servo as sold, asked as a bus would ask it."""

    def __init__(self, angle_rad: float = 0.3104, *, reboot_s: float = 0.0) -> None:
        self.clock = BenchClock()
        self.motor = LagMotor(self.clock, angle_rad)
        now = self.clock.now
        self.servo = Servo(self.motor, device=1, now=now, reboot_s=reboot_s)
        self.clock.servos = [self.servo]

    def get(self, register: Register) -> int:
        """Read a register as a signed number."""
        self.servo.heard()
        return int.from_bytes(self.servo.read(*register), "little", signed=True)

    def put(self, register: Register, value: int) -> None:
        """Write a register."""
        self.servo.heard()
        data = (value % (1 << 8 * register.size)).to_bytes(register.size, "little")
        self.servo.write(register.address, data)

    def refusal(self, register: Register, value: int) -> Refusal | None:
        """Return why a value is refused; None if it is not."""
        try:
            self.put(register, value)
        except Refused as refused:
            return refused.why
        return None

    def wait(self, seconds: float) -> None:
        """Let time pass; nobody asks."""
        self.clock.sleep_until(self.clock.now() + seconds)

    def turning(self, goal: int = CENTRE + 4 * reg.TURN) -> One:
        """Switch torque on in extended position mode, towards a goal."""
        self.put(reg.OPERATING_MODE, reg.EXTENDED_POSITION)
        self.put(reg.TORQUE_ENABLE, 1)
        self.put(reg.GOAL_POSITION, goal)
        return self


@pytest.fixture
def one() -> One:
    """Unpack a servo."""
    return One()


# As it comes.


@pytest.mark.parametrize("angle_rad", [0.0, 0.3104, -17.0])
def test_wherever_it_stands_it_starts_at_its_centre_with_torque_off(angle_rad: float) -> None:
    one = One(angle_rad)
    assert (one.get(reg.POSITION), one.get(reg.GOAL_POSITION)) == (CENTRE, CENTRE)
    assert one.get(reg.TORQUE_ENABLE) == 0
    assert not one.motor.on


def test_it_is_new_enough_for_a_watchdog(one: One) -> None:
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


def test_its_clock_counts_milliseconds_and_begins_again(one: One) -> None:
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
def test_what_it_measures_cannot_be_written(one: One, register: Register) -> None:
    before = one.get(register)
    assert one.refusal(register, 77) is Refusal.ACCESS
    assert one.get(register) == before


def test_of_a_write_that_reaches_too_far_nothing_is_taken(one: One) -> None:
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


def test_beyond_its_table_there_is_nothing(one: One) -> None:
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


def test_with_torque_it_goes_to_its_goal_over_several_turns(one: One) -> None:
    for goal in (CENTRE + 5 * reg.TURN + 7, -3 * reg.TURN - 11):
        one.put(reg.TORQUE_ENABLE, 0)
        one.turning(goal)
        one.wait(SETTLED_S)
        assert one.get(reg.POSITION) == goal


def test_without_torque_it_stays_and_keeps_the_goal_for_later(one: One) -> None:
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


def test_another_mode_forgets_whole_turns(one: One) -> None:
    one.turning(CENTRE + 3 * reg.TURN + 40)
    one.wait(SETTLED_S)
    one.put(reg.TORQUE_ENABLE, 0)
    one.put(reg.OPERATING_MODE, POSITION_MODE)
    assert one.get(reg.POSITION) == CENTRE + 40


# The watchdog.


def test_it_counts_in_20_ms(one: One) -> None:
    one.turning()
    one.put(reg.WATCHDOG, 10)
    assert one.servo.trips_at == pytest.approx(one.clock.now() + 0.200, abs=1e-9)  # rounding
    one.wait(0.198)
    assert one.get(reg.WATCHDOG) == 10  # asking is enough
    one.wait(0.198)
    assert one.get(reg.WATCHDOG) == 10
    one.wait(0.202)
    assert one.get(reg.WATCHDOG) == reg.TRIPPED


def test_it_is_off_as_sold(one: One) -> None:
    one.turning()
    assert one.servo.trips_at == inf
    one.wait(10.0)
    assert one.get(reg.WATCHDOG) == 0


def test_it_does_not_watch_while_torque_is_off(one: One) -> None:
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


def test_what_is_no_hardware_error_cannot_be_latched(one: One) -> None:
    with pytest.raises(ValueError, match=r"^watchdog is no hardware error$"):
        one.servo.fail("watchdog")


def test_a_high_current_for_long_is_an_overload(one: One) -> None:
    one.turning()
    for load_a, seconds in ((1.1 * OVERLOAD_A, 0.9 * OVERLOAD_S), (0.9 * OVERLOAD_A, 5.0)):
        one.motor.load_a = -load_a
        for _ in range(round(seconds / 0.1)):
            one.wait(0.1)
            assert one.get(reg.HARDWARE_ERROR) == 0
    one.motor.load_a = 1.1 * OVERLOAD_A
    one.get(reg.CURRENT)
    one.wait(1.1 * OVERLOAD_S)
    one.get(reg.CURRENT)
    assert one.get(reg.HARDWARE_ERROR) == 0x20
    assert not one.motor.on


# A reboot.


def test_a_reboot_forgets_ram_and_keeps_the_eeprom(one: One) -> None:
    one.put(reg.RETURN_DELAY, 0)
    one.put(reg.INDIRECT_ADDRESS, int.from_bytes(pack("<H", reg.POSITION.address) * 28, "little"))
    one.put(reg.STATUS_LEVEL, 1)
    one.turning(3000)
    one.put(reg.WATCHDOG, 20)
    one.wait(0.1)
    one.servo.reboot()
    fresh = One()
    for register in (reg.WATCHDOG, reg.STATUS_LEVEL, reg.INDIRECT_ADDRESS, reg.TORQUE_ENABLE):
        assert one.get(register) == fresh.get(register)
    assert one.get(reg.OPERATING_MODE) == reg.EXTENDED_POSITION
    assert one.get(reg.RETURN_DELAY) == 0
    assert one.get(reg.TICK) == 0
    assert not one.motor.on


@pytest.mark.parametrize("turns", [5, -5])
def test_a_reboot_forgets_whole_turns_and_moves_nothing(one: One, turns: int) -> None:
    one.turning(CENTRE + turns * reg.TURN + 40)
    one.wait(SETTLED_S)
    before, *_ = one.motor.measure()
    one.servo.reboot()
    assert one.get(reg.POSITION) == one.get(reg.GOAL_POSITION) == CENTRE + 40
    one.put(reg.TORQUE_ENABLE, 1)
    one.wait(SETTLED_S)
    step_rad = Units().position_rad
    assert one.motor.measure()[0] == pytest.approx(before, abs=step_rad)  # rounded to a step


def test_after_a_reboot_it_takes_a_while_to_answer() -> None:
    one = One(reboot_s=0.3)
    assert one.servo.awake
    one.servo.reboot()
    one.wait(0.298)
    assert not one.servo.awake
    one.wait(0.004)
    assert one.servo.awake
    assert one.get(reg.TICK) <= 2


def test_what_was_registered_waits_for_the_action(one: One) -> None:
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


def test_the_block_is_read_in_one_go(one: One) -> None:
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
