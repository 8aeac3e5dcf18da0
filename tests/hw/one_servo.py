"""One servo as sold, asked as a bus would ask it, in time moved by hand."""

from __future__ import annotations

from tests.hw.emulated import BenchClock, LagMotor

from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.packets import Refusal
from endolock.hw.dynamixel.registers import Register
from endolock.hw.emulator.servo_model import CENTRE, Refused, Servo

SETTLED_S = 1.0
"""Forty lags of the motor: nothing is left of a step."""


class One:
    """It, its motor and its clock."""

    def __init__(self, angle_rad: float = 0.3104, *, reboot_s: float = 0.0) -> None:
        self.clock = BenchClock()
        self.motor = LagMotor(self.clock, angle_rad)
        now = self.clock.now
        self.servo = Servo(self.motor, device=1, now=now, reboot_s=reboot_s)
        self.clock.servos = [self.servo]

    def get(self, register: Register) -> int:
        """Read a register as a signed number."""
        self.servo.heard()
        return register.decode(self.servo.read(*register))

    def put(self, register: Register, value: int) -> None:
        """Write a register."""
        self.servo.heard()
        data = register.encode(value)
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
