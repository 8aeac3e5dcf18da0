"""The control table of Dynamixel X-series servos, as far as handles use it, and its units.

Reference:
    ROBOTIS e-Manual, "XM430-W350", control table; all entries of `models.MODELS` have the same
    addresses. Models of the size 330 have their indirect data at 208.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from struct import Struct
from typing import NamedTuple

from endolock.hw.api import Fault


class Register(NamedTuple):
    """Address and size of a value in the control table."""

    address: int
    size: int
    """[bytes]"""

    def encode(self, value: int) -> bytes:
        """Return the bytes of a value, little-endian; negative ones in two's complement.

        Raises:
            OverflowError: the register holds the value neither signed nor unsigned.
        """
        return value.to_bytes(self.size, "little", signed=value < 0)

    def encode_signed(self, value: int) -> bytes:
        """Return the bytes of a signed value, little-endian.

        Raises:
            OverflowError: it is too large for a signed number of this size.
        """
        return value.to_bytes(self.size, "little", signed=True)

    def decode(self, data: bytes | bytearray) -> int:
        """Return the signed value of these bytes."""
        return int.from_bytes(data, "little", signed=True)

    def unsigned(self, value: int) -> int:
        """Return a signed value of this register as an unsigned one."""
        return value & (1 << 8 * self.size) - 1


MODEL = Register(0, 2)
FIRMWARE = Register(6, 1)
ID = Register(7, 1)
BAUD = Register(8, 1)
RETURN_DELAY = Register(9, 1)
DRIVE_MODE = Register(10, 1)
OPERATING_MODE = Register(11, 1)
SECONDARY_ID = Register(12, 1)
PROTOCOL = Register(13, 1)
HOMING_OFFSET = Register(20, 4)
PWM_LIMIT = Register(36, 2)
CURRENT_LIMIT = Register(38, 2)
VELOCITY_LIMIT = Register(44, 4)
MAX_POSITION = Register(48, 4)
MIN_POSITION = Register(52, 4)
STARTUP = Register(60, 1)
SHUTDOWN = Register(63, 1)
TORQUE_ENABLE = Register(64, 1)
STATUS_LEVEL = Register(68, 1)
REGISTERED = Register(69, 1)
HARDWARE_ERROR = Register(70, 1)
POSITION_D = Register(80, 2)
POSITION_I = Register(82, 2)
POSITION_P = Register(84, 2)
FEEDFORWARD_2 = Register(88, 2)
FEEDFORWARD_1 = Register(90, 2)
WATCHDOG = Register(98, 1)
GOAL_PWM = Register(100, 2)
GOAL_CURRENT = Register(102, 2)
PROFILE = Register(108, 8)
"""Acceleration and velocity of the device's own ramp; zero disables it."""
GOAL_POSITION = Register(116, 4)
TICK = Register(120, 2)
CURRENT = Register(126, 2)
VELOCITY = Register(128, 4)
POSITION = Register(132, 4)
VOLTAGE = Register(144, 2)
TEMPERATURE = Register(146, 1)
INDIRECT_ADDRESS = Register(168, 56)
INDIRECT_DATA = Register(224, 28)
END = 662
"""Size of the table [bytes]."""
EEPROM_END = 64
"""Registers below are kept without power, and locked while torque is on."""

EXTENDED_POSITION, CURRENT_POSITION = 4, 5
"""Operating modes that count several turns: without and with a current limit."""
TICK_PERIOD = 32768
"""The device's 1 ms clock wraps around after this number of ticks."""
WATCHDOG_UNIT_S = 0.020
TRIPPED = -1
"""Value of the watchdog register after it has stopped the motor, as a signed byte."""
TURN = 4096
"""Counts of the encoder in one turn."""
LARGEST_GOAL = 1_048_575
"""Largest goal in extended position mode, in either direction [counts]."""
OLDEST_FIRMWARE = 38
"""First version with a bus watchdog. Source: e-Manual."""
STARTUP_FIRMWARE = 45
"""First version with a startup configuration. Source: e-Manual."""
FULL_PWM = 885
"""PWM of the whole supply voltage [1/885]. Source: e-Manual."""
NO_SECONDARY_ID = 253
"""From this value on a motor has no secondary id. Source: e-Manual."""
BAUDS = (9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
"""Baud rates, indexed by the value of their register."""

BLOCK = (WATCHDOG, TORQUE_ENABLE, HARDWARE_ERROR, GOAL_POSITION, TICK, CURRENT, VELOCITY, POSITION)
"""Registers that every cycle reads from a motor, gathered by its indirect addresses."""
BLOCK_SIZE = sum(register.size for register in BLOCK)
BLOCK_ADDRESSES = tuple(a for r in BLOCK for a in range(r.address, r.address + r.size))
_BLOCK = Struct("<bBBiHhii")


class Block(NamedTuple):
    """Values of the registers of `BLOCK`."""

    watchdog: int
    torque: int
    hardware_error: int
    goal: int
    tick: int
    current: int
    velocity: int
    position: int


def unpack(data: bytes) -> Block:
    """Decode the `BLOCK_SIZE` bytes of a block."""
    return Block(*_BLOCK.unpack(data))


@dataclass(frozen=True, kw_only=True)
class Units:
    """Units of one count of a register; the defaults are those of an XM430-W350."""

    position_rad: float = 2 * pi / TURN
    """Position [rad]."""
    velocity_rad_s: float = 0.229 * 2 * pi / 60
    """Velocity [rad/s]: 0.229 rpm."""
    current_a: float = 2.69e-3
    """Current [A]."""


HARDWARE_ERRORS: dict[int, tuple[Fault, str, str]] = {
    0x01: ("voltage", "its supply is out of range", "check the power supply"),
    0x04: ("overheat", "it is too hot", "let it cool"),
    0x08: ("encoder", "its encoder fails", "replace the motor if it comes back"),
    0x10: ("voltage", "it had an electrical shock or too little power", "check the power supply"),
    0x20: ("overload", "its load is too high for too long", "free the handle"),
}
"""Bits of the hardware error register: kind, what happened, what to do first."""
NAMES: dict[int, str] = {
    value.address: name for name, value in list(globals().items()) if isinstance(value, Register)
}
"""Names of the registers by address, as in hw/PROTOCOL.md."""
DEFAULT_SHUTDOWN = 0x34
"""Hardware errors that switch torque off: overload, electrical shock, overheat."""
