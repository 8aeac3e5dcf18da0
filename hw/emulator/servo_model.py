"""Model of an X-series servo: control table, torque, watchdog, latched errors, reboot.

The mechanism is behind `Motor`: the twin's handles, or anything else. The direct twin drives these
servos without a bus, the emulator through one; so both fail in the same ways.

Reference:
    ROBOTIS e-Manual, "XM430-W350". Behaviour that it does not specify is marked as assumed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache
from math import inf
from operator import itemgetter
from struct import Struct, unpack_from
from typing import Protocol

from endolock.hw.api import Fault
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.packets import Refusal
from endolock.hw.dynamixel.port import DEFAULT_BAUD
from endolock.hw.dynamixel.registers import Register, Units

XM430_W350 = 1020
"""Model number."""
FIRMWARE = 45
CENTRE = 2048
"""Position of a motor that starts at angle zero [counts]."""
OVERLOAD_A, OVERLOAD_S = 1.0, 1.0
"""A current above this for this time is an overload [A], [s]. Assumed: it stalls at 2.3 A."""
LARGEST_WORD = 32767
_MEASURED = Struct("<hii")
_FACTORY: tuple[tuple[Register, int], ...] = (
    (reg.MODEL, XM430_W350),
    (reg.FIRMWARE, FIRMWARE),
    (reg.RETURN_DELAY, 250),
    (reg.OPERATING_MODE, 3),
    (Register(13, 1), 2),  # protocol
    (Register(31, 1), 80),  # temperature limit
    (Register(32, 2), 160),  # voltage limits
    (Register(34, 2), 95),
    (Register(36, 2), 885),  # PWM limit
    (reg.CURRENT_LIMIT, 1193),
    (Register(44, 4), 200),  # velocity limit
    (reg.MAX_POSITION, 4095),
    (reg.SHUTDOWN, reg.DEFAULT_SHUTDOWN),
)
_STARTED: tuple[tuple[Register, int], ...] = (
    (reg.STATUS_LEVEL, 2),
    (reg.POSITION_P, 800),
    (reg.GOAL_CURRENT, 1193),
    (reg.VOLTAGE, 120),
    (reg.TEMPERATURE, 30),
)
_READ_ONLY = (range(7), range(reg.REGISTERED.address, 71), range(120, 168))
_GOALS = (range(100, 108), range(reg.GOAL_POSITION.address, 120))
"""Read-only after the watchdog has tripped."""
_RANGES: dict[Register, tuple[int, int]] = {
    reg.BAUD: (0, 7),
    reg.OPERATING_MODE: (0, 16),
    reg.TORQUE_ENABLE: (0, 1),
    reg.WATCHDOG: (0, 127),
    reg.GOAL_POSITION: (-reg.LARGEST_GOAL, reg.LARGEST_GOAL),
}
_REACTING = {register.address: register for register in (*_RANGES, reg.HOMING_OFFSET)}


@lru_cache
def _touched(address: int, size: int) -> tuple[Register, ...]:
    """Return the registers that react when these bytes are written."""
    return tuple(r for a, r in _REACTING.items() if address < a + r.size and address + size > a)


@lru_cache
def _read_only(address: int, size: int) -> bool:
    return any(address < r.stop and address + size > r.start for r in _READ_ONLY)


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
        units: units of its registers.
        reboot_s: time without answers after a reboot or a short loss of power [s].
        baud: its baud rate, one of `registers.BAUDS` [1/s].
    """

    def __init__(
        self,
        motor: Motor,
        *,
        device: int,
        now: Callable[[], float],
        units: Units | None = None,
        reboot_s: float = 0.0,
        baud: int = DEFAULT_BAUD,
    ) -> None:
        self._motor, self._units = motor, units or Units()
        self.now = now
        self.reboot_s = reboot_s
        self._table = bytearray(reg.END)
        self._store(reg.ID, device)
        self._store(reg.BAUD, reg.BAUDS.index(baud))
        for register, value in _FACTORY:
            self._store(register, value)
        self._shift = self._offset = 0
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
        if _read_only(address, len(data)):
            raise Refused(Refusal.ACCESS)
        if address < reg.EEPROM_END and self._table[reg.TORQUE_ENABLE.address]:
            raise Refused(Refusal.ACCESS)
        touched = _touched(address, len(data))
        if any(r.address < address or r.address + r.size > end for r in touched):
            raise Refused(Refusal.DATA_LENGTH)
        tripped = self._signed(reg.WATCHDOG) == reg.TRIPPED
        if tripped and any(address < r.stop and end > r.start for r in _GOALS):
            raise Refused(Refusal.DATA_RANGE)
        values = {r: self._part(r, address, data) for r in touched}
        for register, value in values.items():
            low, high = _RANGES.get(register, (-(2**31), 2**31))
            if not low <= value <= high:
                raise Refused(Refusal.DATA_RANGE)
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
        self._table[reg.EEPROM_END :] = bytes(reg.END - reg.EEPROM_END)
        for register, value in _STARTED:
            self._store(register, value)
        for first in (reg.INDIRECT_ADDRESS.address, 578):
            data = {168: 224, 578: 634}[first]
            for n in range(28):  # each points to its own address
                self._store(Register(first + 2 * n, 2), data + n)
        self._gathers.clear()
        self._heard = self.now()
        self._overloaded = self._registered = None
        self._motor.power(False)
        angle, _, _ = self._motor.measure()
        self._shift = position - round(angle / self._units.position_rad)
        self._store(reg.GOAL_POSITION, position)

    def _react(self, register: Register, value: int) -> None:
        if register is reg.GOAL_POSITION:
            self._aim(value)
        elif register is reg.TORQUE_ENABLE:
            self._torque(bool(value))
        elif register is reg.OPERATING_MODE:
            self._shift += self._within_a_turn() - self._position()
        elif register is reg.HOMING_OFFSET:
            self._shift += value - self._offset
            self._offset = value

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
        self._motor.aim((counts - self._shift) * self._units.position_rad)

    def _position(self) -> int:
        angle, _, _ = self._motor.measure()
        return round(angle / self._units.position_rad) + self._shift

    def _within_a_turn(self) -> int:
        return (self._position() - self._offset) % reg.TURN + self._offset

    def _measure(self) -> None:
        angle, speed, current = self._motor.measure()
        units, table = self._units, self._table
        counts = round(current / units.current_a)
        _MEASURED.pack_into(
            table,
            reg.CURRENT.address,
            max(-LARGEST_WORD, min(counts, LARGEST_WORD)),
            round(speed / units.velocity_rad_s),
            round(angle / units.position_rad) + self._shift,
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

    def _signed(self, register: Register) -> int:
        return register.decode(self._table[register.address : register.address + register.size])

    def _part(self, register: Register, address: int, data: bytes) -> int:
        start = register.address - address
        return register.decode(data[start : start + register.size])
