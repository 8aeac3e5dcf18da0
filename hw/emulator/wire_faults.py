"""Faults of a wire and of motors on purpose, to test the drivers and one's own code.

A fault is written KIND=SHARE where it affects packets at random, KIND:MOTOR@SECONDS where it
happens once; see `parse`.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from endolock.hw.api import ConfigError
from endolock.hw.dynamixel.packets import HEADER, Instruction
from endolock.hw.emulator.emulated_bus import EmulatedBus

RANDOM = ("drop", "flip", "duplicate", "insert", "truncate", "late", "lost")
"""One byte of a packet missing, wrong, doubled or added; its end missing; an answer delayed until
the next ones; a goal that never arrives."""
ONCE = ("reset", "overload", "overheat", "voltage", "encoder", "silence", "unplug")
"""A motor that restarts, or latches a hardware error; a line that is silent, or unplugged."""
_FORM = re.compile(
    r"(?P<kind>[a-z]+)(:(?P<motor>\d+))?(=(?P<share>[\d.]+))?(@(?P<at>[\d.]+))?(\+(?P<lasts>[\d.]+))?"
)


@dataclass(frozen=True, kw_only=True)
class WireFault:
    """One fault."""

    kind: str
    """One of `RANDOM` or `ONCE`."""
    share: float = 0.0
    """Fraction of packets that it affects at random [1]."""
    at_s: float = 0.0
    """When it happens or begins [s]."""
    lasts_s: float = 0.0
    """Duration of a silence or an unplugging [s]; 0: without end."""
    motor: int = 0
    """Id of the motor concerned."""


def parse(text: str) -> WireFault:
    """Read a fault, such as flip=0.05, reset:2@5, or silence@3+0.5.

    Raises:
        ConfigError: not a fault.
    """
    found = _FORM.fullmatch(text)
    kind = found["kind"] if found else ""
    try:
        if found and kind in RANDOM and 0 < float(found["share"]) <= 1 and not found["motor"]:
            return WireFault(kind=kind, share=float(found["share"]), at_s=float(found["at"] or 0))
        if found and kind in ONCE and not found["share"]:
            return WireFault(
                kind=kind,
                motor=int(found["motor"] or 1),
                at_s=float(found["at"] or 0),
                lasts_s=float(found["lasts"] or 0),
            )
    except (TypeError, ValueError):
        pass
    raise ConfigError(
        f"fault '{text}' is unknown",
        f"use {', '.join(RANDOM)} as in flip=0.05, or "
        f"{', '.join(ONCE)} as in reset:2@5 or silence@3+0.5",
    )


class FaultyBus:
    """An emulated bus with a faulty wire.

    Args:
        bus: the bus behind the wire.
        now: returns the time [s].
        faults: what goes wrong.
        seed: of the random numbers.
    """

    def __init__(
        self,
        bus: EmulatedBus,
        now: Callable[[], float],
        faults: Sequence[WireFault] = (),
        seed: int = 0,
    ) -> None:
        self._bus, self._now = bus, now
        self.servos = bus.servos
        self._random = random.Random(seed)
        self._chances: list[WireFault] = []
        self._pending: list[WireFault] = []
        self._silences: list[WireFault] = []
        for fault in faults:
            self.add(fault)
        self._held: list[bytes] = []
        self.struck = 0
        """Number of packets changed at random so far."""

    def respond(self, data: bytes, baud: int | None = None) -> list[bytes]:
        """Take bytes from the host, return the answers; see `EmulatedBus.respond`."""
        self.happen()
        if self._silent():
            return []
        arrived = b"".join(self._damaged(packet, request=True) for packet in _packets(data))
        answers = self._bus.respond(arrived, baud)
        now, self._held = self._held, []
        return now + [self._damaged(answer, request=False) for answer in answers]

    def add(self, fault: WireFault) -> None:
        """Add a fault; unplugging is left to the line."""
        if fault.kind in RANDOM:
            self._chances.append(fault)
        elif fault.kind == "silence":
            self._silences.append(fault)
        elif fault.kind != "unplug":
            self._pending = sorted([*self._pending, fault], key=lambda f: f.at_s)

    def mend(self) -> None:
        """Remove all faults."""
        for faults in (self._chances, self._silences, self._pending, self._held):
            faults.clear()

    def happen(self) -> None:
        """Apply the faults of motors that are due."""
        while self._pending and self._pending[0].at_s <= self._now():
            fault = self._pending.pop(0)
            self.strike(fault.kind, fault.motor)

    def strike(self, kind: str, motor: int) -> None:
        """Apply a fault to a motor now: reset, or a hardware error by name."""
        for servo in self.servos:
            if servo.id == motor and kind == "reset":
                servo.reboot()
            elif servo.id == motor:
                servo.fail(kind)  # type: ignore[arg-type]  # chosen above, or refused there

    def _silent(self) -> bool:
        now = self._now()
        return any(
            f.at_s <= now and (not f.lasts_s or now < f.at_s + f.lasts_s) for f in self._silences
        )

    def _damaged(self, packet: bytes, *, request: bool) -> bytes:
        for fault in self._chances:
            if self._now() < fault.at_s or self._random.random() >= fault.share:
                continue
            if fault.kind == "lost" and not (request and packet[7:8] == _SYNC_WRITE):
                continue
            if fault.kind == "late" and request:
                continue
            self.struck += 1
            packet = self._strike_packet(fault.kind, packet)
        return packet

    def _strike_packet(self, kind: str, packet: bytes) -> bytes:
        if not packet:
            return packet
        index = self._random.randrange(len(packet))
        before, byte, after = packet[:index], packet[index : index + 1], packet[index + 1 :]
        if kind == "drop":
            return before + after
        if kind == "flip":
            return before + bytes((byte[0] ^ 1 << self._random.randrange(8),)) + after
        if kind == "duplicate":
            return before + byte + byte + after
        if kind == "insert":
            return before + bytes((self._random.randrange(256),)) + byte + after
        if kind == "truncate":
            return before
        if kind == "late":
            self._held.append(packet)
        return b""


_SYNC_WRITE = bytes((Instruction.SYNC_WRITE,))


def _packets(data: bytes) -> list[bytes]:
    """Split a stream before each header."""
    first, *rest = data.split(HEADER)
    return [part for part in (first, *(HEADER + part for part in rest)) if part]
