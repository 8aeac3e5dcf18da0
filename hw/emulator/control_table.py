"""The control table of an emulated servo: as sold, after a start, and what each register accepts.

Reference:
    ROBOTIS e-Manual, "XM430-W350", control table.
"""

from __future__ import annotations

from functools import lru_cache

from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.models import Model
from endolock.hw.dynamixel.registers import Register

FIRMWARE = 45
LARGEST_GAIN = 16_383
_INDIRECT = ((reg.INDIRECT_ADDRESS.address, reg.INDIRECT_DATA.address), (578, 634))
"""Two groups of 28: first indirect address, and the first data to which it points."""
_READ_ONLY = (range(7), range(reg.REGISTERED.address, 71), range(120, 168))
_GAINS = (
    reg.POSITION_D,
    reg.POSITION_I,
    reg.POSITION_P,
    reg.FEEDFORWARD_2,
    reg.FEEDFORWARD_1,
)
STRENGTH = (reg.POSITION_P, reg.GOAL_PWM, reg.GOAL_CURRENT, reg.PWM_LIMIT)
"""Registers that decide whether a motor is strong enough to move."""
RESTORED = (*_GAINS, reg.PROFILE, reg.INDIRECT_ADDRESS)
"""Registers that a start leaves as they are where the startup configuration says so. Source:
DYNAMIXEL Wizard, "Restoring RAM area"; that they were backed up last: assumed."""
_RANGES: dict[Register, tuple[int, int]] = {
    reg.BAUD: (0, 7),
    reg.DRIVE_MODE: (0, 15),
    reg.OPERATING_MODE: (0, 16),
    reg.PROTOCOL: (1, 2),
    reg.PWM_LIMIT: (0, reg.FULL_PWM),
    reg.STARTUP: (0, 3),
    reg.TORQUE_ENABLE: (0, 1),
    reg.STATUS_LEVEL: (0, 2),
    **dict.fromkeys(_GAINS, (0, LARGEST_GAIN)),
    reg.WATCHDOG: (0, 127),
    reg.GOAL_POSITION: (-reg.LARGEST_GOAL, reg.LARGEST_GOAL),
}
_ANY = (reg.HOMING_OFFSET, reg.CURRENT_LIMIT, reg.GOAL_PWM, reg.GOAL_CURRENT)
_REACTING = {register.address: register for register in (*_RANGES, *_ANY)}
_UNBOUNDED = (-(2**31), 2**31)


def sold(model: Model) -> dict[Register, int]:
    """Return what is kept without power, as sold."""
    return {
        reg.MODEL: model.number,
        reg.FIRMWARE: FIRMWARE,
        reg.RETURN_DELAY: 250,
        reg.OPERATING_MODE: 3,
        reg.SECONDARY_ID: 255,
        reg.PROTOCOL: 2,
        Register(31, 1): 80,  # temperature limit
        Register(32, 2): 160,  # voltage limits
        Register(34, 2): 95,
        reg.PWM_LIMIT: reg.FULL_PWM,
        reg.CURRENT_LIMIT: model.current_limit,
        reg.VELOCITY_LIMIT: 200,  # of an XM430-W350; no effect here
        reg.MAX_POSITION: 4095,
        reg.SHUTDOWN: reg.DEFAULT_SHUTDOWN,
    }


def started(model: Model, pwm_limit: int, current_limit: int) -> dict[Register, int]:
    """Return what a start sets, apart from the indirect addresses."""
    return {
        reg.STATUS_LEVEL: 2,
        reg.VOLTAGE: 120,
        reg.TEMPERATURE: 30,
        **of_mode(model, pwm_limit, current_limit),
    }


def of_mode(model: Model, pwm_limit: int, current_limit: int) -> dict[Register, int]:
    """Return what a start and a change of the operating mode set."""
    return {
        **dict.fromkeys(_GAINS, 0),
        reg.POSITION_P: model.position_p,
        reg.GOAL_PWM: pwm_limit,
        reg.GOAL_CURRENT: current_limit,
        reg.PROFILE: 0,
    }


def indirect() -> dict[Register, int]:
    """Return the indirect addresses after a start: each points to its own data."""
    rows = [(first, data, n) for first, data in _INDIRECT for n in range(28)]
    return {Register(first + 2 * n, 2): data + n for first, data, n in rows}


def limits(register: Register) -> tuple[int, int]:
    """Return the lowest and highest value that a register accepts."""
    return _RANGES.get(register, _UNBOUNDED)


@lru_cache
def touched(address: int, size: int) -> tuple[Register, ...]:
    """Return the registers that are checked, or react, when these bytes are written."""
    return tuple(r for a, r in _REACTING.items() if address < a + r.size and address + size > a)


@lru_cache
def read_only(address: int, size: int) -> bool:
    """Return whether one of these bytes cannot be written."""
    return any(address < r.stop and address + size > r.start for r in _READ_ONLY)
