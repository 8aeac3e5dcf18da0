"""A bench in virtual time: two light motors behind emulated servos, a bus, a wire that may fail."""

from __future__ import annotations

from collections.abc import Sequence
from math import exp

from endolock.hw.api import AXES, Clock, Command, State
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.models import XM430_W350, Model
from endolock.hw.dynamixel.registers import Units
from endolock.hw.dynamixel.servo_bus import Bus
from endolock.hw.dynamixel.servo_drive import ServoDrive
from endolock.hw.emulator.emulated_bus import EmulatedBus
from endolock.hw.emulator.loopback import Loopback
from endolock.hw.emulator.servo_model import Servo
from endolock.hw.emulator.wire_faults import FaultyBus, WireFault
from endolock.hw.guard import Guard

PERIOD_S = 0.02
STEP_RAD = Units().position_rad
START = (0.3104, -0.1706)
"""Where the handles stand when power comes on [rad]: not zero, not a whole count."""


class BenchClock:
    """Virtual time; the servos' own clocks run on it, their watchdogs too."""

    realtime = False
    timestep_s = 0.0

    def __init__(self) -> None:
        self._t = 0.0
        self.servos: Sequence[Servo] = ()

    def now(self) -> float:
        """Time since it was made [s]."""
        return self._t

    def sleep_until(self, t: float) -> float:
        """Go to `t` [s] by steps of 2 ms at most, never back."""
        while self._t < t:
            self._t = min(t, self._t + 0.002)
            for servo in self.servos:
                servo.watch()
        return self._t


class LagMotor:
    """A motor of first order, p' = (goal - p) / lag, that stays where it is without power."""

    def __init__(self, clock: Clock, angle_rad: float) -> None:
        self._clock, self._at = clock, clock.now()
        self.angle_rad = self.goal_rad = angle_rad
        self.on = False
        self.load_a = 0.0
        self.lag_s = 0.025

    def measure(self) -> tuple[float, float, float]:
        """Return angle, speed and current."""
        now = self._clock.now()
        if self.on:
            left = exp((self._at - now) / self.lag_s)
            self.angle_rad = self.goal_rad + (self.angle_rad - self.goal_rad) * left
        self._at = now
        speed = (self.goal_rad - self.angle_rad) / self.lag_s if self.on else 0.0
        return self.angle_rad, speed, self.load_a

    def aim(self, angle_rad: float) -> None:
        """Make that the goal."""
        self.measure()
        self.goal_rad = angle_rad

    def power(self, on: bool) -> None:
        """Switch torque."""
        self.measure()
        self.on = on


class Emulated:
    """Everything from guard to motor."""

    def __init__(
        self,
        *faults: WireFault,
        seed: int = 0,
        handles: dict[str, Handle] | None = None,
        models: tuple[Model, Model] = (XM430_W350, XM430_W350),
    ):
        self.clock = BenchClock()
        self.motors = [LagMotor(self.clock, angle) for angle in START]
        now = self.clock.now
        rows = zip(self.motors, models, strict=True)
        self.servos = [
            Servo(motor, device=i, now=now, model=model) for i, (motor, model) in enumerate(rows, 1)
        ]
        self.clock.servos = self.servos
        self.wire = FaultyBus(EmulatedBus(self.servos, now), now, faults, seed)
        self.port = Loopback(self.wire)
        usual = {axis: Handle(id=i, zero_counts=2048) for i, axis in enumerate(AXES, 1)}
        self.handles = handles or usual
        names = {handle.id: axis for axis, handle in self.handles.items()}
        self.bus = Bus(self.port, self.clock, names)
        self.drive = ServoDrive(self.bus, self.clock, self.handles)
        self.guard = Guard(self.drive)

    def angles(self) -> tuple[float, ...]:
        """Return where the handles really are, counted from where they started [rad]."""
        rows = zip(self.motors, START, strict=True)
        return tuple(m.measure()[0] - round(a / STEP_RAD) * STEP_RAD for m, a in rows)

    def follow(self, n: int, position: tuple[float, float] | None = None) -> list[State]:
        """Exchange this number of times, every 20 ms, with the same command, or without one."""
        states = []
        for _ in range(n):
            self.wait(PERIOD_S)
            command = None if position is None else Command(position=position)
            states.append(self.guard.exchange(command))
        return states

    def wait(self, seconds: float) -> None:
        """Let time pass without the host."""
        self.clock.sleep_until(self.clock.now() + seconds)
