"""Settings that a servo needs before cycles can start, written at connecting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from struct import pack
from typing import NamedTuple, Protocol

from endolock.hw.api import Clock, HardwareError, LinkError, LinkLost, StateError
from endolock.hw.dynamixel import models
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.models import Model
from endolock.hw.dynamixel.registers import Register, Units
from endolock.hw.dynamixel.servo_bus import Accept, Cycle
from endolock.hw.dynamixel.settings import SETTINGS, Policy, Setting, Wish

RESTART_S = 1.0
"""Longest time until a motor answers again after a reboot [s]. Assumed: X series take 0.3 s."""


class Reads(Protocol):
    """Read access to the registers of motors."""

    def read(self, device: int, register: Register) -> int:
        """Read a register as a signed number."""


class Link(Reads, Protocol):
    """Access to the registers of motors: `Bus`, or `DirectLink`."""

    def open(self) -> None:
        """Open it."""

    def close(self) -> None:
        """Close it."""

    def ping(self, device: int) -> tuple[int, int]:
        """Return model number and firmware version."""

    def write(self, device: int, register: Register, value: int | bytes) -> None:
        """Write a register."""

    def reboot(self, device: int) -> None:
        """Restart a motor."""

    def cycle(self, goals: Sequence[int | None] | None, accept: Accept) -> Cycle:
        """Send the goals that are given, read all blocks."""


class Identity(NamedTuple):
    """Which motor it is."""

    model: Model
    firmware: int


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """One motor after connecting, as run.toml describes it."""

    model: str
    firmware: int
    units: Units
    registers: dict[str, int]
    """Value of each of `settings.SETTINGS` by its key, read after everything was written."""
    changed: tuple[str, ...]
    """What was written because another program had left it otherwise."""


def identify(link: Link, clock: Clock, handles: Mapping[str, Handle]) -> list[Identity]:
    """Find out which motors these are, without a write; only then let them answer to everything.

    Args:
        link: connects to them.
        clock: stamps errors.
        handles: how each drives its wheel, by axis.

    Raises:
        StateError: one has no entry in `models.MODELS`, or too old a firmware; nothing was written.
        HardwareError: one does not answer.
    """
    found = []
    for axis, handle in handles.items():
        number, firmware = link.ping(handle.id)  # answered whatever the status return level is
        who = f"handle motor {handle.id} ({axis})"
        model = models.MODELS.get(number)
        if model is None:
            raise StateError(
                f"{who} is not usable, and nothing was written to it: {models.described(number)}",
                models.FIT,
                t=clock.now(),
                axis=axis,
            )
        if firmware < model.oldest_firmware:
            raise StateError(
                f"{who} has firmware {firmware}, without a bus watchdog",
                f"update it to {model.oldest_firmware} or newer",
                t=clock.now(),
                axis=axis,
            )
        found.append(Identity(model, firmware))
    for handle in handles.values():
        # A lower level leaves this write unanswered, but not the one that is sent again.
        link.write(handle.id, reg.STATUS_LEVEL, 2)
    return found


def prepare(
    link: Link,
    clock: Clock,
    handles: Mapping[str, Handle],
    found: Sequence[Identity],
    units: Units | None,
) -> list[Prepared]:
    """Set all motors up so that goals mean what they should; torque is off.

    What is kept without power is set at all motors before anything else at any: a motor with a
    secondary id would obey what is meant for another one.

    Args:
        link: connects to them.
        clock: stamps errors.
        handles: how each drives its wheel, by axis.
        found: see `identify`.
        units: units of their registers; those of each model if None.

    Raises:
        StateError: one cannot be used as it is set.
        HardwareError: one refuses, does not answer, or does not keep what was written.
    """
    motors = [
        _Motor(link, clock, axis, Wish(handle=h, model=f.model, units=units or f.model.units), f)
        for (axis, h), f in zip(handles.items(), found, strict=True)
    ]
    for motor in motors:
        motor.refuse()
    for kept in (True, False):
        for motor in motors:
            motor.write(kept=kept)
    gathered = pack(f"<{reg.BLOCK_SIZE}H", *reg.BLOCK_ADDRESSES)
    for motor in motors:
        link.write(motor.device, reg.INDIRECT_ADDRESS, gathered)
    return [motor.checked() for motor in motors]


def read_settings(link: Reads, device: int, firmware: int, *, kept: bool) -> dict[str, int]:
    """Read the settings of a motor, by name, with a single request.

    That request covers addresses without a register too; a motor that refuses it is asked for each
    register. A busy line or machine has fewer chances to fail than with a request for each.

    Args:
        link: connects to it.
        device: its id.
        firmware: its version; settings that it lacks are left out.
        kept: those kept without power; otherwise the others.
    """
    chosen = [s for s in SETTINGS if s.kept is kept and firmware >= s.since]
    first = chosen[0].register.address
    last = chosen[-1].register
    span = Register(first, last.address + last.size - first)
    try:
        data = span.encode_signed(link.read(device, span))
    except LinkError:
        raise
    except HardwareError:
        return {s.name: s.value(link.read(device, s.register)) for s in chosen}
    found = {}
    for setting in chosen:
        start, size = setting.register.address - first, setting.register.size
        found[setting.name] = setting.value(setting.register.decode(data[start : start + size]))
    return found


class _Motor:
    """One motor while it is set up."""

    def __init__(self, link: Link, clock: Clock, axis: str, wish: Wish, found: Identity) -> None:
        self._link, self._clock, self._axis = link, clock, axis
        self._wish, self._found = wish, found
        self.device = wish.handle.id
        self._values: dict[str, int] = {}
        self._changed: list[str] = []

    def refuse(self) -> None:
        """Read what is kept; raise an error for a value that only somebody else may change."""
        self._values = self._read(kept=True)
        self._check([Policy.REFUSE])

    def write(self, *, kept: bool) -> None:
        """Write what differs: the EEPROM has a limited number of write cycles."""
        if not kept:  # a new operating mode has changed some of them
            self._values = self._read(kept=False)
        for setting in self._present():
            value, wanted = self._values[setting.name], setting.wanted(self._wish)
            if setting.policy is not Policy.SET or wanted is None:
                continue
            if setting.differs(value, self._wish):
                self._link.write(self.device, setting.register, setting.register.encode(wanted))
                self._changed.append(f"{setting.name} {value} -> {wanted}")

    def checked(self) -> Prepared:
        """Read all settings again: an answer has no number, it may have been to another request."""
        self._values = self._read(kept=True) | self._read(kept=False)
        self._check([Policy.REFUSE, Policy.SET])
        return Prepared(
            model=self._wish.model.name,
            firmware=self._found.firmware,
            units=self._wish.units,
            registers={setting.key: self._values[setting.name] for setting in self._present()},
            changed=tuple(self._changed),
        )

    def _read(self, *, kept: bool) -> dict[str, int]:
        return read_settings(self._link, self.device, self._found.firmware, kept=kept)

    def _present(self) -> list[Setting]:
        return [setting for setting in SETTINGS if setting.name in self._values]

    def _check(self, policies: Sequence[Policy]) -> None:
        """Raise an error for a setting that is not as it must be."""
        for setting in self._present():
            value = self._values[setting.name]
            if setting.policy in policies and setting.differs(value, self._wish):
                raise self._unusable(setting, value)

    def _unusable(self, setting: Setting, value: int) -> StateError:
        return StateError(
            f"handle motor {self.device} ({self._axis}) has a {setting.problem(value, self._wish)}",
            setting.cure,
            t=self._clock.now(),
            axis=self._axis,
        )


def await_restart(link: Link, clock: Clock, axis: str, device: int) -> None:
    """Wait until a motor answers again after a reboot.

    Raises:
        LinkLost: it does not within `RESTART_S`.
    """
    end = clock.now() + RESTART_S
    while True:
        try:
            link.ping(device)
            return
        except LinkLost as error:
            if clock.now() >= end:
                raise LinkLost(
                    f"handle motor {device} ({axis}) does not answer after its restart",
                    "check its power",
                    recovery=("clear_fault",),
                    t=clock.now(),
                    axis=axis,
                ) from error
            clock.sleep_until(clock.now() + 0.05)
