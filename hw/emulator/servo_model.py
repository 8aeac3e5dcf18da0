"""Model of an X-series servo: control table, torque, watchdog, latched errors, reboot.

The mechanism is behind `Motor`: the twin's handles, or anything else. The direct twin drives these
servos without a bus, the emulator through one; so both fail in the same ways.

Reference:
    ROBOTIS e-Manual, "XM430-W350". Behaviour that it does not specify is marked as assumed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from math import inf
from operator import itemgetter
from struct import Struct, unpack_from
from typing import Protocol

from endolock.hw.api import Fault
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.models import XM430_W350, Model
from endolock.hw.dynamixel.packets import Refusal
from endolock.hw.dynamixel.port import DEFAULT_BAUD
from endolock.hw.dynamixel.registers import Register, Units
from endolock.hw.emulator import control_table

CENTRE = 2048
"""Position of a motor that starts at angle zero [counts]."""
OVERLOAD_A, OVERLOAD_S = 1.0, 1.0
"""A current above this for this time is an overload [A], [s]. Assumed: it stalls at 2.3 A."""
LARGEST_WORD = 32767
REVERSED, TORQUE_BY_GOAL = 0x01, 0x08
"""Bits of the drive mode."""
STARTS_WITH_TORQUE, RESTORES = 0x01, 0x02
"""Bits of the startup configuration."""
_MEASURED = Struct("<hii")
_GOALS = (range(100, 108), range(reg.GOAL_POSITION.address, 120))
"""Read-only after the watchdog has tripped."""


class Refused(Exception):
    """The device refuses.

    Args:
        why: sent in the error byte of its answer.
    """

    def __init__(self, why: Refusal) -> None:
        super().__init__(why.text)
        self.why = why


class Motor(Protocol):
    """The mechanism that a servo turns."""

    def measure(self) -> tuple[float, float, float]:
        """Return angle [rad], speed [rad/s] and current [A]."""

    def aim(self, angle_rad: float) -> None:
        """Set the goal."""

    def power(self, on: bool) -> None:
        """Switch torque; the goal becomes the present angle."""


class Servo:
    """One servo.

    Args:
        motor: the mechanism that it turns.
        device: its id.
        now: returns the time [s].
        model: its model.
        units: units of its registers; those of its model if None.
        reboot_s: time without answers after a reboot or a short loss of power [s].
        baud: its baud rate, one of `registers.BAUDS` [1/s].
    """

    def __init__(
        self,
        motor: Motor,
        *,
        device: int,
        now: Callable[[], float],
        model: Model = XM430_W350,
        units: Units | None = None,
        reboot_s: float = 0.0,
        baud: int = DEFAULT_BAUD,
    ) -> None:
        self._motor, self._model, self._units = motor, model, units or model.units
        self.now = now
        self.reboot_s = reboot_s
        self._table = bytearray(reg.END)
        self._store(reg.ID, device)
        self._store(reg.BAUD, reg.BAUDS.index(baud))
        for register, value in control_table.sold(model).items():
            self._store(register, value)
        self._shift = self._offset = 0
        self._sign, self._strong = 1, True
        self._started = 0.0
        self._heard = 0.0
        self._overloaded: float | None = None
        self._registered: tuple[int, bytes] | None = None
        self._gathers: dict[tuple[int, int], Callable[[bytearray], Iterable[int]]] = {}
        """Functions that gather indirect data from the table, by address and size."""
        self._start(CENTRE)

    @property
    def id(self) -> int:
        """Its id on the bus."""
        return self._table[reg.ID.address]

    @property
    def secondary_id(self) -> int | None:
        """A second id, to which it listens without an answer."""
        value = self._table[reg.SECONDARY_ID.address]
        return value if value < reg.NO_SECONDARY_ID else None

    @property
    def understands(self) -> bool:
        """Whether it is set to protocol 2.0."""
        return self._table[reg.PROTOCOL.address] == 2

    @property
    def baud(self) -> int:
        """Its baud rate [1/s]."""
        return reg.BAUDS[self._table[reg.BAUD.address]]

    @property
    def return_delay_s(self) -> float:
        """Delay before it answers [s]."""
        return 2e-6 * self._table[reg.RETURN_DELAY.address]

    @property
    def status_level(self) -> int:
        """What it answers: 0 pings, 1 reads as well, 2 everything."""
        return self._table[reg.STATUS_LEVEL.address]

    @property
    def awake(self) -> bool:
        """Whether it answers; false while it starts."""
        return self.now() >= self._started

    @property
    def alert(self) -> bool:
        """Whether a hardware error is latched."""
        return bool(self._table[reg.HARDWARE_ERROR.address])

    @property
    def trips_at(self) -> float:
        """When the watchdog stops the motor unless a packet comes before [s]; inf if never."""
        units = self._signed(reg.WATCHDOG)
        if units <= 0 or not self._table[reg.TORQUE_ENABLE.address]:
            return inf
        return self._heard + units * reg.WATCHDOG_UNIT_S

    def watch(self) -> None:
        """Let the watchdog stop the motor if its time is over."""
        if self.now() > self.trips_at:
            self._store(reg.WATCHDOG, reg.TRIPPED)
            self._stop()

    def heard(self) -> None:
        """Restart the watchdog's time: a packet for this servo was received."""
        self.watch()
        self._heard = self.now()

    def read(self, address: int, size: int) -> bytes:
        """Read registers.

        Raises:
            Refused: they do not exist.
        """
        if address + size > reg.END:
            raise Refused(Refusal.ACCESS)
        self._measure()
        first, end = reg.INDIRECT_DATA.address, reg.INDIRECT_DATA.address + reg.INDIRECT_DATA.size
        if first <= address < end and size and address + size <= end:
            gather = self._gathers.get((address, size))
            if gather is None:
                offset = reg.INDIRECT_ADDRESS.address + 2 * (address - first)
                words = unpack_from(f"<{size}H", self._table, offset)
                # The first one twice: of a single index an itemgetter returns no tuple.
                gather = self._gathers[address, size] = itemgetter(*words, words[0])
            try:
                return bytes(gather(self._table))[:size]
            except IndexError:
                raise Refused(Refusal.ACCESS) from None
        return bytes(self._table[address : address + size])

    def write(self, address: int, data: bytes) -> None:
        """Write registers.

        Raises:
            Refused: they are read-only, or do not accept these values.
        """
        end = address + len(data)
        if end > reg.END:
            raise Refused(Refusal.ACCESS)
        if control_table.read_only(address, len(data)):
            raise Refused(Refusal.ACCESS)
        if address < reg.EEPROM_END and self._table[reg.TORQUE_ENABLE.address]:
            raise Refused(Refusal.ACCESS)
        touched = control_table.touched(address, len(data))
        if any(r.address < address or r.address + r.size > end for r in touched):
            raise Refused(Refusal.DATA_LENGTH)
        tripped = self._signed(reg.WATCHDOG) == reg.TRIPPED
        if tripped and any(address < r.stop and end > r.start for r in _GOALS):
            raise Refused(Refusal.DATA_RANGE)
        values = {r: self._part(r, address, data) for r in touched}
        for register, value in values.items():
            low, high = control_table.limits(register)
            if not low <= value <= high:
                raise Refused(Refusal.DATA_RANGE)
        self._check_limits(values)
        if reg.GOAL_POSITION in values:
            self._check_goal(values[reg.GOAL_POSITION])
        if reg.TORQUE_ENABLE in values and values[reg.TORQUE_ENABLE] and self._shut_down:
            raise Refused(Refusal.ACCESS)
        self._table[address:end] = data
        if address < reg.INDIRECT_DATA.address and end > reg.INDIRECT_ADDRESS.address:
            self._gathers.clear()
        for register, value in values.items():
            self._react(register, value)

    def register(self, address: int, data: bytes) -> None:
        """Store a write until `act`."""
        self._registered = address, data
        self._store(reg.REGISTERED, 1)

    def act(self) -> None:
        """Carry out the stored write.

        Raises:
            Refused: there is none, or it cannot be written.
        """
        if self._registered is None:
            raise Refused(Refusal.INSTRUCTION)
        kept, self._registered = self._registered, None
        self._store(reg.REGISTERED, 0)
        self.write(*kept)

    def reboot(self) -> None:
        """Restart: torque off; all but the EEPROM is reset, whole turns too."""
        self._start(self._within_a_turn())
        self._started = self.now() + self.reboot_s

    def fail(self, kind: Fault) -> None:
        """Latch a hardware error.

        Raises:
            ValueError: that kind is not a hardware error.
        """
        bits = [bit for bit, (name, *_) in reg.HARDWARE_ERRORS.items() if name == kind]
        if not bits:
            raise ValueError(f"{kind} is not a hardware error")
        self._table[reg.HARDWARE_ERROR.address] |= bits[0]
        if self._shut_down:
            self._torque(False)

    @property
    def _shut_down(self) -> bool:
        table = self._table
        return bool(table[reg.HARDWARE_ERROR.address] & table[reg.SHUTDOWN.address])

    def _start(self, position: int) -> None:
        startup = self._table[reg.STARTUP.address]
        restored = control_table.RESTORED if startup & RESTORES else ()
        before = {register: self._bytes(register) for register in restored}
        self._table[reg.EEPROM_END :] = bytes(reg.END - reg.EEPROM_END)
        limits = self._signed(reg.PWM_LIMIT), self._signed(reg.CURRENT_LIMIT)
        begun = control_table.started(self._model, *limits) | control_table.indirect()
        for register, value in begun.items():
            self._store(register, value)
        for register, data in before.items():
            self._table[register.address : register.address + register.size] = data
        self._gathers.clear()
        self._heard = self.now()
        self._overloaded = self._registered = None
        self._motor.power(False)
        angle, _, _ = self._motor.measure()
        self._shift = position - self._sign * round(angle / self._units.position_rad)
        self._store(reg.GOAL_POSITION, position)
        self._strong = self._is_strong()
        if startup & STARTS_WITH_TORQUE:
            self._torque(True)

    def _react(self, register: Register, value: int) -> None:
        if register is reg.GOAL_POSITION:
            if self._table[reg.DRIVE_MODE.address] & TORQUE_BY_GOAL and not self._shut_down:
                self._torque(True)
            self._aim(value)
        elif register is reg.TORQUE_ENABLE:
            self._torque(bool(value))
        elif register is reg.OPERATING_MODE:
            self._shift += self._within_a_turn() - self._position()
            limits = self._signed(reg.PWM_LIMIT), self._signed(reg.CURRENT_LIMIT)
            for other, initial in control_table.of_mode(self._model, *limits).items():
                self._store(other, initial)
            self._strong = self._is_strong()
        elif register is reg.HOMING_OFFSET:
            self._shift += value - self._offset
            self._offset = value
        elif register is reg.DRIVE_MODE:
            self._reverse(bool(value & REVERSED))
        elif register in control_table.STRENGTH:
            self._strong = self._is_strong()
            if self._table[reg.TORQUE_ENABLE.address]:
                self._aim(self._signed(reg.GOAL_POSITION))

    def _reverse(self, reverse: bool) -> None:
        """Count positions in the other direction, or as sold."""
        sign = -1 if reverse else 1
        if sign != self._sign:
            position = -self._position()
            self._sign = sign
            self._shift += position - self._position()

    def _is_strong(self) -> bool:
        """Return whether it moves at all: not with a gain or a limit of 0."""
        pwm = min(abs(self._signed(reg.GOAL_PWM)), self._signed(reg.PWM_LIMIT))
        limited = self._table[reg.OPERATING_MODE.address] in (0, reg.CURRENT_POSITION)
        current = abs(self._signed(reg.GOAL_CURRENT)) if limited else 1
        return min(pwm, current, self._signed(reg.POSITION_P)) > 0

    def _check_limits(self, values: Mapping[Register, int]) -> None:
        """Check values whose limits are other registers."""
        for goal, limit in ((reg.GOAL_PWM, reg.PWM_LIMIT), (reg.GOAL_CURRENT, reg.CURRENT_LIMIT)):
            if goal in values and abs(values[goal]) > self._signed(limit):
                raise Refused(Refusal.DATA_LIMIT)
        if not 0 <= values.get(reg.CURRENT_LIMIT, 0) <= self._model.current_limit:
            raise Refused(Refusal.DATA_RANGE)

    def _check_goal(self, counts: int) -> None:
        """Check a goal: in position mode it must be within the limits."""
        if self._table[reg.OPERATING_MODE.address] == 3:
            low, high = self._signed(reg.MIN_POSITION), self._signed(reg.MAX_POSITION)
            if not low <= counts <= high:
                raise Refused(Refusal.DATA_LIMIT)

    def _torque(self, on: bool) -> None:
        self._table[reg.TORQUE_ENABLE.address] = on
        self._heard = self.now()
        self._motor.power(on)
        if on:
            self._aim(self._signed(reg.GOAL_POSITION))

    def _stop(self) -> None:
        self._aim(self._position())

    def _aim(self, counts: int) -> None:
        if not self._strong:
            counts = self._position()
        self._motor.aim(self._sign * (counts - self._shift) * self._units.position_rad)

    def _position(self) -> int:
        angle, _, _ = self._motor.measure()
        return self._sign * round(angle / self._units.position_rad) + self._shift

    def _within_a_turn(self) -> int:
        return (self._position() - self._offset) % reg.TURN + self._offset

    def _measure(self) -> None:
        angle, speed, current = self._motor.measure()
        units, table, sign = self._units, self._table, self._sign
        counts = sign * round(current / units.current_a)
        _MEASURED.pack_into(
            table,
            reg.CURRENT.address,
            max(-LARGEST_WORD, min(counts, LARGEST_WORD)),
            sign * round(speed / units.velocity_rad_s),
            sign * round(angle / units.position_rad) + self._shift,
        )
        now = self.now()
        tick = round((now - self._started) * 1000) % reg.TICK_PERIOD
        self._store(reg.TICK, tick)
        if abs(current) <= OVERLOAD_A:
            self._overloaded = None
        elif self._overloaded is None:
            self._overloaded = now
        elif now - self._overloaded > OVERLOAD_S:
            self.fail("overload")

    def _store(self, register: Register, value: int) -> None:
        self._table[register.address : register.address + register.size] = register.encode(value)

    def _bytes(self, register: Register) -> bytes:
        return bytes(self._table[register.address : register.address + register.size])

    def _signed(self, register: Register) -> int:
        return register.decode(self._bytes(register))

    def _part(self, register: Register, address: int, data: bytes) -> int:
        start = register.address - address
        return register.decode(data[start : start + register.size])
