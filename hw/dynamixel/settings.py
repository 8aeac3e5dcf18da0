"""Registers that decide what a goal means, the values they must have, and what to do otherwise.

Another program may have left any of them. Connecting, `endolock doctor`, its set-up, run.toml and
hw/PROTOCOL.md all use this table. SET: written at connecting. REFUSE: kept, since somebody may
have had a reason, or since the zero of the handle depends on it. RECORD: only in run.toml.

Reference:
    ROBOTIS e-Manual, "XM430-W350", control table, and the sections of these registers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from operator import eq, ge

from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.models import Model
from endolock.hw.dynamixel.registers import Register, Units


class Policy(Enum):
    """What connecting does with a register that has another value."""

    SET = "set"
    REFUSE = "refuse"
    RECORD = "record"


@dataclass(frozen=True, kw_only=True)
class Wish:
    """Whose register it is."""

    handle: Handle
    model: Model
    units: Units


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One register."""

    name: str
    """For people."""
    register: Register
    wanted: Callable[[Wish], int | None]
    """Value that it must have; None: any."""
    policy: Policy = Policy.SET
    why: str = ""
    """What another value does."""
    refusal: str = ""
    """The same, after "has a NAME of VALUE,"; empty where the value wanted is named instead."""
    doctor: bool = False
    """Whether `endolock doctor` fails for another value, and its set-up writes this one; not where
    the next program to connect sets it anyway."""
    cure: str = "run endolock doctor --port PORT --set-up"
    """What to do where it is refused."""
    signed: bool = False
    unit: str = ""
    """Of its value, for people."""
    show: Callable[[int, Units], str] = lambda value, _: str(value)
    """Says a value to people."""
    fits: Callable[[int, int], bool] = eq
    """Whether a value is as good as the one wanted."""
    since: int = 0
    """First firmware that has it."""

    @property
    def key(self) -> str:
        """Its key in run.toml."""
        return self.name.lower().replace(" ", "_")

    @property
    def kept(self) -> bool:
        """Whether it is kept without power, and locked while torque is on."""
        return self.register.address < reg.EEPROM_END

    def value(self, read: int) -> int:
        """Return the value of a register as read, signed."""
        return read if self.signed else self.register.unsigned(read)

    def differs(self, value: int, wish: Wish) -> bool:
        """Return whether a value is not as wanted."""
        wanted = self.wanted(wish)
        return wanted is not None and not self.fits(value, wanted)

    def problem(self, value: int, wish: Wish) -> str:
        """Say what is wrong with a value, after "motor ... has a"."""
        unit = f" {self.unit}" if self.unit else ""
        text = f"{self.name} of {self.show(value, wish.units)}{unit}"
        limit_a = wish.handle.current_limit_a
        if self.register is reg.CURRENT_LIMIT and limit_a is not None:
            return f"{text}, below the current_limit_a of its handle, {limit_a:g} A"
        if self.refusal:
            return f"{text}, {self.refusal}"
        return f"{text}, not {self.wanted(wish)}: {self.why}"


def _always(value: int | None) -> Callable[[Wish], int | None]:
    return lambda _: value


def _mode(wish: Wish) -> int:
    free = wish.handle.current_limit_a is None
    return reg.EXTENDED_POSITION if free else reg.CURRENT_POSITION


def _current(wish: Wish) -> int | None:
    limit_a = wish.handle.current_limit_a
    return None if limit_a is None else round(limit_a / wish.units.current_a)


STATUS_LEVEL = Setting(
    name="status return level",
    register=reg.STATUS_LEVEL,
    wanted=_always(2),
    why="it does not answer to everything",
)
"""Written before all others: with another value writes, or reads too, are not answered."""
HOMING_OFFSET = Setting(
    name="homing offset",
    register=reg.HOMING_OFFSET,
    wanted=_always(0),
    policy=Policy.REFUSE,
    why="with an offset a motor creeps after its watchdog has stopped it",
    refusal="with which it would creep after its watchdog has stopped it",
    unit="counts",
    cure="set it to 0, and its zero again, with endolock doctor --port PORT --set-up",
    doctor=True,
    signed=True,
)
CURRENT_LIMIT = Setting(
    name="current limit",
    register=reg.CURRENT_LIMIT,
    wanted=_current,
    policy=Policy.REFUSE,
    why="the motor does not accept the current_limit_a of its handle",
    show=lambda value, units: f"{value} ({value * units.current_a:.3g} A)",
    cure="use a smaller current_limit_a, or raise the motor's with the maker's DYNAMIXEL Wizard",
    fits=ge,
)
"""Its unit depends on the model; without a current limit of the handle it has no effect."""

SETTINGS: tuple[Setting, ...] = (
    Setting(
        name="return delay",
        register=reg.RETURN_DELAY,
        wanted=_always(0),
        why="every answer is delayed by this time",
        show=lambda value, _: f"{value} ({2 * value} us)" if value else "0",
        doctor=True,
    ),
    Setting(
        name="drive mode",
        register=reg.DRIVE_MODE,
        wanted=_always(0),
        why="the motor is reversed, obeys another one, delays its goals, or switches torque on by "
        "a goal",
        doctor=True,
    ),
    Setting(
        name="operating mode",
        register=reg.OPERATING_MODE,
        wanted=_mode,
        why="goals are not positions over several turns",
    ),
    Setting(
        name="secondary id",
        register=reg.SECONDARY_ID,
        wanted=_always(255),
        why="the motor also obeys, without an answer, what is sent to the motor with this id",
        doctor=True,
        fits=lambda value, _: value >= reg.NO_SECONDARY_ID,
    ),
    HOMING_OFFSET,
    Setting(
        name="PWM limit",
        register=reg.PWM_LIMIT,
        wanted=_always(reg.FULL_PWM),
        policy=Policy.REFUSE,
        why="below 885 the motor may be too weak to follow its goals",
        refusal="with which it may be too weak to follow its goals",
        doctor=True,
    ),
    CURRENT_LIMIT,
    Setting(
        name="velocity limit",
        register=reg.VELOCITY_LIMIT,
        wanted=_always(None),
        policy=Policy.RECORD,
    ),
    Setting(
        name="max position",
        register=reg.MAX_POSITION,
        wanted=_always(None),
        policy=Policy.RECORD,
        signed=True,
    ),
    Setting(
        name="min position",
        register=reg.MIN_POSITION,
        wanted=_always(None),
        policy=Policy.RECORD,
        signed=True,
    ),
    Setting(
        name="startup configuration",
        register=reg.STARTUP,
        wanted=_always(0),
        why="after a loss of power the motor has torque at once, or what another program left",
        doctor=True,
        since=reg.STARTUP_FIRMWARE,
    ),
    Setting(
        name="shutdown",
        register=reg.SHUTDOWN,
        wanted=_always(reg.DEFAULT_SHUTDOWN),
        why="overload, overheating or an electrical shock would not switch its torque off",
        doctor=True,
        fits=lambda value, wanted: value & wanted == wanted,
    ),
    STATUS_LEVEL,
    Setting(name="position D", register=reg.POSITION_D, wanted=_always(0)),
    Setting(name="position I", register=reg.POSITION_I, wanted=_always(0)),
    Setting(name="position P", register=reg.POSITION_P, wanted=lambda wish: wish.model.position_p),
    Setting(name="feedforward 2nd", register=reg.FEEDFORWARD_2, wanted=_always(0)),
    Setting(name="feedforward 1st", register=reg.FEEDFORWARD_1, wanted=_always(0)),
    Setting(name="goal PWM", register=reg.GOAL_PWM, wanted=_always(reg.FULL_PWM), signed=True),
    Setting(name="goal current", register=reg.GOAL_CURRENT, wanted=_current, signed=True),
    Setting(name="profile", register=reg.PROFILE, wanted=_always(0)),
)
"""In the order of their addresses. Changing the operating mode sets gains and goals to those of
that mode, so that what is kept without power comes first. Gains in mode 5: those of mode 4,
assumed."""
