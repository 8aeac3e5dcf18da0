"""Servos driven without a bus: the same registers and refusals, but no packets."""

from __future__ import annotations

from collections.abc import Sequence

from endolock.hw.api import Clock, HardwareError
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.packets import Instruction
from endolock.hw.dynamixel.refusals import explained
from endolock.hw.dynamixel.registers import Register
from endolock.hw.dynamixel.servo_bus import Accept, Cycle
from endolock.hw.emulator.servo_model import Refused, Servo


class DirectLink:
    """Access to servos in the same process; see `servo_setup.Link`.

    Args:
        servos: in the order of their blocks.
        clock: stamps errors.
    """

    def __init__(self, servos: Sequence[Servo], clock: Clock) -> None:
        self._servos, self._clock = tuple(servos), clock

    def open(self) -> None:
        """Nothing to do: they are always reachable."""

    def close(self) -> None:
        """Nothing to do."""

    def ping(self, device: int) -> tuple[int, int]:
        """Return model number and firmware version of a servo."""
        return self.read(device, reg.MODEL), self.read(device, reg.FIRMWARE)

    def read(self, device: int, register: Register) -> int:
        """Read a register as a signed number."""
        return register.decode(self._servo(device).read(*register))

    def write(self, device: int, register: Register, value: int | bytes) -> None:
        """Write a register."""
        if isinstance(value, int):
            value = register.encode(value)
        try:
            self._servo(device).write(register.address, value)
        except Refused as refused:
            request = register.address.to_bytes(2, "little") + value
            what, step = explained(Instruction.WRITE, request, refused.why)
            raise HardwareError(
                f"handle motor {device} {what}", step, t=self._clock.now()
            ) from None

    def reboot(self, device: int) -> None:
        """Restart a servo."""
        self._servo(device).reboot()

    def cycle(self, goals: Sequence[int | None] | None, accept: Accept) -> Cycle:
        """Set the goals that are given and read all blocks.

        Raises:
            OverflowError: a goal is too large for its register.
        """
        found: list[bytes | None] = []
        now = self._clock.now()
        for index, servo in enumerate(self._servos):
            servo.heard()
            goal = goals[index] if goals is not None else None
            if goal is not None:
                try:
                    data = reg.GOAL_POSITION.encode_signed(goal)
                    servo.write(reg.GOAL_POSITION.address, data)
                except Refused:
                    pass  # visible in the block, as on a bus
            block = servo.read(reg.INDIRECT_DATA.address, reg.BLOCK_SIZE) if servo.awake else b""
            found.append(block if block and accept(index, block, now, now) else None)
        return Cycle(found, now, now)

    def _servo(self, device: int) -> Servo:
        servo = next(servo for servo in self._servos if servo.id == device)
        servo.heard()
        return servo
