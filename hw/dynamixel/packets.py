"""Packets of the Dynamixel Protocol 2.0: framing, byte stuffing, checksum, and finding them again.

    FF FF FD 00 | id | length | instruction | parameters | CRC-16     numbers little-endian

`length` counts what follows it. Where FF FF FD occurs from the instruction on, another FD is added
after it, so that a packet contains no second header. The checksum is over everything before it. A
status packet, the answer, has the instruction 55, and an error byte before its parameters.

Reference:
    ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0"; hw/PROTOCOL.md has an annotated frame.
"""

from __future__ import annotations

from enum import IntEnum
from struct import Struct
from typing import NamedTuple

from fastcrc import crc16

HEADER = b"\xff\xff\xfd\x00"
_MARK, _STUFFED = b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"
_HEAD = Struct("<4sBH")
_LENGTH = Struct("<H")
BROADCAST = 0xFE
"""Every device listens to this id; in a status packet it marks the answer of several at once."""
LONGEST = 1024
"""A packet whose length field is larger than this counts as damaged [bytes]. Assumed."""
ALERT = 0x80
"""Bit of the error byte: a hardware error is latched in the device."""
crc = crc16.umts
"""The checksum: polynomial 8005, start 0, not reflected."""


class Instruction(IntEnum):
    """What a packet asks for."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    REBOOT = 0x08
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93


class Refusal(IntEnum):
    """Low bits of the error byte: why a device refused."""

    FAILED = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7

    @property
    def text(self) -> str:
        """Its name, for messages."""
        return self.name.lower().replace("_", " ").replace("crc", "CRC")


class Packet(NamedTuple):
    """One packet, without stuffing."""

    id: int
    instruction: int
    parameters: bytes
    """In a status packet the first byte is the error."""


def encode(device: int, instruction: int, parameters: bytes = b"") -> bytes:
    """Return the bytes of a packet.

    Args:
        device: id, 0 to 252, or `BROADCAST`.
        instruction: see `Instruction`.
        parameters: what follows the instruction.
    """
    body = bytes((instruction,)) + parameters
    if _MARK in body:
        body = body.replace(_MARK, _STUFFED)
    raw = _HEAD.pack(HEADER, device, len(body) + 2) + body
    return raw + _LENGTH.pack(crc(raw))


def encode_fast(answers: list[tuple[int, int, bytes]]) -> bytes:
    """Return the single packet in which several devices answer a fast sync read, without stuffing.

    Each device ends its part with the checksum of all bytes up to there; the last one is that of
    the packet.

    Args:
        answers: error byte, id and data of each device.
    """
    size = sum(len(data) + 4 for _, _, data in answers)
    raw = _HEAD.pack(HEADER, BROADCAST, size + 1) + bytes((Instruction.STATUS,))
    for error, device, data in answers:
        raw += bytes((error, device)) + data
        raw += _LENGTH.pack(crc(raw))
    return raw


def split_fast(parameters: bytes, size: int) -> list[tuple[int, int, bytes]]:
    """Split the answer to a fast sync read.

    Args:
        parameters: of the status packet with the id `BROADCAST`.
        size: bytes of data per device.

    Returns:
        Error byte, id and data of each device; empty where the length does not fit.
    """
    part = size + 4
    if (len(parameters) + 2) % part:
        return []
    starts = range(0, len(parameters), part)
    return [(parameters[i], parameters[i + 1], parameters[i + 2 : i + 2 + size]) for i in starts]


class Parser:
    """Finds packets in a stream of bytes, whatever is between them.

    A packet with a wrong checksum is skipped up to the next header, which may be inside it.
    """

    def __init__(self) -> None:
        self._held = bytearray()
        self.damaged = 0
        """Number of packets with a wrong checksum."""

    @property
    def partial(self) -> bool:
        """Whether the stream ends within what may be a packet."""
        return bool(self._held)

    def reset(self) -> None:
        """Discard an unfinished packet."""
        self._held.clear()

    def feed(self, data: bytes) -> list[Packet]:
        """Add bytes; return the packets that they complete."""
        held = self._held
        held += data
        found: list[Packet] = []
        while True:
            start = held.find(_MARK)
            if start < 0:
                begun = 2 if held.endswith(b"\xff\xff") else held.endswith(b"\xff")
                del held[: len(held) - begun]
                return found
            if start:
                del held[:start]
            if len(held) < 7:
                return found
            _, device, length = _HEAD.unpack_from(held)
            if held[3] or not 3 <= length <= LONGEST:
                del held[:1]
                continue
            end = 7 + length
            if len(held) < end:
                return found
            raw = bytes(held[:end])
            if crc(raw[:-2]) != _LENGTH.unpack_from(raw, end - 2)[0]:
                self.damaged += 1
                del held[:1]
                continue
            body = raw[7:-2]
            fast = device == BROADCAST and body[0] == Instruction.STATUS
            if _STUFFED in body and not fast:
                body = body.replace(_STUFFED, _MARK)
            found.append(Packet(device, body[0], body[1:]))
            del held[:end]
