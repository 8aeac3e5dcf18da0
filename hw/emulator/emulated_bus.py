"""Servos on one line: packets in, answers out.

Packets that are damaged or addressed to no servo are not answered, as on a real bus.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from struct import unpack_from
from typing import Protocol

from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.packets import (
    ALERT,
    BROADCAST,
    Instruction,
    Packet,
    Parser,
    Refusal,
    encode,
    encode_fast,
)
from endolock.hw.emulator.servo_model import Refused, Servo

UNFINISHED_S = 0.003
"""An unfinished packet is discarded after this pause [s]. Assumed."""


class AnsweringBus(Protocol):
    """An `EmulatedBus`, or one whose wire has faults."""

    @property
    def servos(self) -> Sequence[Servo]:
        """The servos on the line."""

    def respond(self, data: bytes, baud: int | None = None) -> list[bytes]:
        """Take bytes from the host, return the answers."""


class EmulatedBus:
    """Answers the requests of a host.

    Args:
        servos: those on the line.
        now: returns the time [s].
    """

    def __init__(self, servos: Sequence[Servo], now: Callable[[], float]) -> None:
        self.servos = tuple(servos)
        self._now = now
        self._parser = Parser()
        self._last_s = 0.0
        self._calls: dict[int, Callable[[Packet, list[Servo]], list[bytes]]] = {
            Instruction.PING: self._ping,
            Instruction.READ: self._read,
            Instruction.WRITE: self._write,
            Instruction.REG_WRITE: self._register,
            Instruction.ACTION: self._act,
            Instruction.REBOOT: self._reboot,
            Instruction.SYNC_READ: self._sync_read,
            Instruction.SYNC_WRITE: self._sync_write,
            Instruction.FAST_SYNC_READ: self._fast_sync_read,
            Instruction.BULK_READ: self._bulk_read,
            Instruction.BULK_WRITE: self._bulk_write,
        }

    def respond(self, data: bytes, baud: int | None = None) -> list[bytes]:
        """Take bytes from the host, return the answers in order.

        Args:
            data: the bytes as received.
            baud: baud rate of the line [1/s]; servos set to another one ignore it. None: any.
        """
        now = self._now()
        if self._parser.partial and now - self._last_s > UNFINISHED_S:
            self._parser.reset()
        self._last_s = now
        answers: list[bytes] = []
        for packet in self._parser.feed(data):
            here = [s for s in self.servos if s.awake and s.understands and baud in (None, s.baud)]
            answers += self._answer(packet, here)
        return answers

    def _answer(self, packet: Packet, here: list[Servo]) -> list[bytes]:
        if packet.id != BROADCAST:
            if packet.instruction in (Instruction.WRITE, Instruction.REG_WRITE):
                self._shadow(packet, here)
            here = [servo for servo in here if servo.id == packet.id]
        for servo in here:
            servo.heard()
        if packet.instruction == Instruction.STATUS:
            return []
        call = self._calls.get(packet.instruction)
        why = Refusal.INSTRUCTION
        if call is not None:
            try:
                return call(packet, here)
            except (IndexError, ValueError):  # shorter than its parameters claim
                why = Refusal.DATA_LENGTH
        if packet.id == BROADCAST:
            return []
        level = 1 if packet.instruction == Instruction.READ else 2
        return [self._status(servo, why) for servo in here if servo.status_level >= level]

    def _shadow(self, packet: Packet, here: list[Servo]) -> None:
        """Let servos with this secondary id obey too, without an answer and but for the EEPROM."""
        for servo in here:
            if servo.id == packet.id or servo.secondary_id != packet.id:
                continue
            servo.heard()
            address = int.from_bytes(packet.parameters[:2], "little")
            if address < reg.EEPROM_END:
                continue
            with suppress(Refused):
                if packet.instruction == Instruction.WRITE:
                    servo.write(address, packet.parameters[2:])
                else:
                    servo.register(address, packet.parameters[2:])

    def _ping(self, _packet: Packet, here: list[Servo]) -> list[bytes]:
        answers = []
        for servo in sorted(here, key=lambda servo: servo.id):
            model = servo.read(reg.MODEL.address, reg.MODEL.size)
            answers.append(self._status(servo, 0, model + servo.read(reg.FIRMWARE.address, 1)))
        return answers

    def _read(self, packet: Packet, here: list[Servo]) -> list[bytes]:
        address, size = _numbers(packet.parameters)
        found = [
            self._read_status(servo, address, size) for servo in here if packet.id != BROADCAST
        ]
        return [answer for answer in found if answer]

    def _write(self, packet: Packet, here: list[Servo]) -> list[bytes]:
        (address,) = _numbers(packet.parameters[:2])
        return self._done(packet, here, lambda s: s.write(address, packet.parameters[2:]))

    def _register(self, packet: Packet, here: list[Servo]) -> list[bytes]:
        (address,) = _numbers(packet.parameters[:2])
        return self._done(packet, here, lambda s: s.register(address, packet.parameters[2:]))

    def _act(self, packet: Packet, here: list[Servo]) -> list[bytes]:
        return self._done(packet, here, lambda servo: servo.act())

    def _reboot(self, packet: Packet, here: list[Servo]) -> list[bytes]:
        answers = self._done(packet, here, lambda servo: None)
        for servo in here:
            servo.reboot()
        return answers

    def _sync_write(self, packet: Packet, here: list[Servo]) -> list[bytes]:
        address, size = _numbers(packet.parameters[:4])
        rest = packet.parameters[4:]
        for start in range(0, len(rest) - size, size + 1):
            data = rest[start + 1 : start + 1 + size]
            _write_silently(here, rest[start], address, data)
        return []

    def _sync_read(self, packet: Packet, here: list[Servo]) -> list[bytes]:
        address, size = _numbers(packet.parameters[:4])
        by_id = {servo.id: servo for servo in here}
        found = []
        for device in packet.parameters[4:]:
            if servo := by_id.get(device):
                found.append(self._read_status(servo, address, size))
        return [answer for answer in found if answer]

    def _fast_sync_read(self, packet: Packet, here: list[Servo]) -> list[bytes]:
        address, size = _numbers(packet.parameters[:4])
        by_id = {servo.id: servo for servo in here}
        parts = []
        for device in packet.parameters[4:]:
            servo = by_id.get(device)
            # Each adds its part to that of the previous one: the chain breaks.
            if servo is None or servo.status_level < 1:
                return []
            try:
                parts.append((self._error(servo, 0), device, servo.read(address, size)))
            except Refused:
                return []
        return [encode_fast(parts)] if parts else []

    def _bulk_read(self, packet: Packet, here: list[Servo]) -> list[bytes]:
        by_id = {servo.id: servo for servo in here}
        answers = []
        if len(packet.parameters) % 5:
            raise ValueError
        for start in range(0, len(packet.parameters), 5):
            device, address, size = unpack_from("<BHH", packet.parameters, start)
            if servo := by_id.get(device):
                answers.append(self._read_status(servo, address, size))
        return [answer for answer in answers if answer]

    def _bulk_write(self, packet: Packet, here: list[Servo]) -> list[bytes]:
        rest = packet.parameters
        while len(rest) >= 5:
            device, address, size = unpack_from("<BHH", rest)
            if len(rest) >= 5 + size:
                _write_silently(here, device, address, rest[5 : 5 + size])
            rest = rest[5 + size :]
        return []

    def _read_status(self, servo: Servo, address: int, size: int) -> bytes | None:
        if servo.status_level < 1:
            return None
        try:
            return self._status(servo, 0, servo.read(address, size))
        except Refused as refused:
            return self._status(servo, refused.why)

    def _done(
        self, packet: Packet, here: list[Servo], call: Callable[[Servo], None]
    ) -> list[bytes]:
        answers = []
        for servo in here:
            answers_at_all = packet.id != BROADCAST and servo.status_level == 2
            try:
                call(servo)
                why = 0
            except Refused as refused:
                why = refused.why
            if answers_at_all:
                answers.append(self._status(servo, why, device=packet.id))
        return answers

    def _status(
        self, servo: Servo, why: int, data: bytes = b"", device: int | None = None
    ) -> bytes:
        error = bytes((self._error(servo, why),))
        named = servo.id if device is None else device
        return encode(named, Instruction.STATUS, error + data)

    def _error(self, servo: Servo, why: int) -> int:
        return why | (ALERT if servo.alert else 0)


def _numbers(parameters: bytes) -> tuple[int, ...]:
    """Read 16-bit numbers; a ValueError where a byte is missing."""
    if len(parameters) % 2 or not parameters:
        raise ValueError
    return unpack_from(f"<{len(parameters) // 2}H", parameters)


def _write_silently(here: list[Servo], device: int, address: int, data: bytes) -> None:
    """Write to those with this id or secondary id, without an answer, also where one refuses."""
    for servo in here:
        shadow = servo.secondary_id == device and address >= reg.EEPROM_END
        if servo.id == device or shadow:
            with suppress(Refused):
                servo.write(address, data)
