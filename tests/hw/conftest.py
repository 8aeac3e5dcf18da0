"""Drives for the guard's contract: the twin's, and a small one whose link and handles can fail."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import exp
from typing import Protocol

import pytest

from endolock.hw.api import AXES, Clock, HardwareError, Limits
from endolock.hw.drive import Reading
from endolock.hw.dynamixel.servo_bus import Bus
from endolock.hw.dynamixel.servo_drive import ServoDrive
from endolock.hw.emulator.emulated_bus import EmulatedBus
from endolock.hw.emulator.loopback import Loopback
from endolock.hw.guard import Guard
from endolock.twin.physics import motor
from endolock.twin.rig import TwinRig
from endolock.twin.world.instrument import Instrument


class HandClock:
    """A clock that moves only when somebody sleeps on it."""

    realtime = False
    timestep_s = 0.0

    def __init__(self) -> None:
        self._t = 0.0

    def now(self) -> float:
        """Time since it was made [s]."""
        return self._t

    def sleep_until(self, t: float) -> float:
        """Go to `t` [s], never back."""
        self._t = max(self._t, t)
        return self._t


class BenchDrive:
    """Two servos of first order, p' = (goal - p) / LAG_S, away from zero when power comes on."""

    LAG_S = 0.025
    STEP_RAD = 0.001

    def __init__(self) -> None:
        self.axes: tuple[str, ...] = AXES
        self.step_rad = (self.STEP_RAD, self.STEP_RAD)
        # Different on every side, so that a swapped axis or sign shows.
        self.limits = Limits(position_rad=((-2.0, 1.0), (-0.8, 1.5)), velocity_rad_s=(3.0, 1.5))
        self.clock: Clock = HandClock()
        self.answers = True
        """Goals arrive all the same; only what comes back is lost."""
        self.blocked = False
        self.breaks: HardwareError | None = None
        """Raised by every transfer and by `close`."""
        self.on = False
        self.handle: tuple[float, ...] = (0.3104, -0.1706)
        self._goal: tuple[float, ...] = (0.0, 0.0)
        self._zero: tuple[float, ...] = (0.0, 0.0)
        self._at = 0.0
        self._reading = self._measure()

    def open(self) -> None:
        """Torque is off when power comes on."""
        self.on = False

    def transfer(self, goal: tuple[float, ...] | None) -> Reading:
        """Take a goal, and answer unless answers are withheld."""
        if self.breaks:
            raise self.breaks
        self._catch_up()
        if goal is not None:
            self._goal = tuple(g + z for g, z in zip(self.quantise(goal), self._zero, strict=True))
        if not self.answers:
            return replace(self._reading, fresh=False)
        self._reading = self._measure()
        return self._reading

    def quantise(self, goal: tuple[float, ...]) -> tuple[float, ...]:
        """Round to whole steps."""
        return tuple(round(g / self.STEP_RAD) * self.STEP_RAD for g in goal)

    def measure(self) -> Reading:
        """Measure."""
        return self.transfer(None)

    def hold(self, goal: tuple[float | None, ...]) -> None:
        """Take the goals that are given."""
        kept = zip(goal, self._goal, self._zero, strict=True)
        self.transfer(tuple(g - z if at is None else at for at, g, z in kept))

    def recover(self) -> None:
        """Torque off."""
        self.torque(False)

    def torque(self, on: bool) -> None:
        """Switch torque; a handle without it stays where it is."""
        self._catch_up()
        self.on = on

    def zero(self, position: tuple[float, ...]) -> None:
        """Count from there."""
        self._zero = self.quantise(tuple(p + z for p, z in zip(position, self._zero, strict=True)))

    def close(self) -> None:
        """Torque off."""
        self.on = False
        if self.breaks:
            raise self.breaks

    def _catch_up(self) -> None:
        """Move the handles as they have moved since last time; exact, as the goal stood still."""
        now = self.clock.now()
        left = exp((self._at - now) / self.LAG_S) if self.on and not self.blocked else 1.0
        self.handle = tuple(
            g + (p - g) * left for p, g in zip(self.handle, self._goal, strict=True)
        )
        self._at = now

    def _measure(self) -> Reading:
        away = tuple(p - z for p, z in zip(self.handle, self._zero, strict=True))
        return Reading(
            t=self._at,
            t_err=0.0,
            position=self.quantise(away),
            velocity=(0.0, 0.0),
            current=(0.0, 0.0),
            fresh=True,
            device_tick=round(self._at * 1000),
        )


class Make(Protocol):
    """Makes a guard that is not connected yet."""

    def __call__(self, *, blocked: bool = False) -> Guard:
        """Block the handles, or leave them free."""


def _twin(*, blocked: bool = False) -> Guard:
    # A millinewton metre moves nothing: the wires pull with some 100 mN m.
    instrument = Instrument(handle_torque_nm=0.001) if blocked else None
    return TwinRig("rest", instrument=instrument, pictures=False).actuators


def _emulated(*, blocked: bool = False) -> Guard:
    # The same handles, behind bytes on a bus.
    instrument = Instrument(handle_torque_nm=0.001) if blocked else Instrument()
    rig = TwinRig("rest", instrument=instrument, pictures=False)
    handles = motor.handles(instrument)
    names = {handle.id: axis for axis, handle in handles.items()}
    wire = EmulatedBus(rig.servos, rig.clock.now)
    bus = Bus(Loopback(wire), rig.clock, names)
    return Guard(ServoDrive(bus, rig.clock, handles, motor.units(instrument)))


def _bench(*, blocked: bool = False) -> Guard:
    drive = BenchDrive()
    drive.blocked = blocked
    return Guard(drive)


@pytest.fixture(
    scope="session", params=[_twin, _emulated, _bench], ids=["twin", "emulated", "bench"]
)
def make(request: pytest.FixtureRequest) -> Make:
    """Everything asked of a guard is asked in front of each drive."""
    chosen: Make = request.param
    return chosen


@pytest.fixture
def guard(make: Make) -> Iterator[Guard]:
    """Connect a guard."""
    with make() as connected:
        yield connected


@pytest.fixture
def bench() -> BenchDrive:
    """Make a drive to play tricks with."""
    return BenchDrive()
