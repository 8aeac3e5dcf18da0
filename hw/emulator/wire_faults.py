"""What can go wrong on a wire and in a motor, on purpose: for tests and for trying one's own code.

A fault is written KIND=SHARE where it strikes packets by chance, KIND:MOTOR@SECONDS where it
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

BY_CHANCE = ("drop", "flip", "duplicate", "insert", "truncate", "late", "lost")
"""One byte of a packet gone, wrong, double or too many; its end gone; an answer that comes only
with the next ones; a goal that never arrives."""
ONCE = ("reset", "overload", "overheat", "voltage", "encoder", "silence", "unplug")
"""A motor that starts anew, or latches a hardware error; a line that is silent, or unplugged."""
_FORM = re.compile(
    r"(?P<kind>[a-z]+)(:(?P<motor>\d+))?(=(?P<share>[\d.]+))?(@(?P<at>[\d.]+))?(\+(?P<lasts>[\d.]+))?"
)


@dataclass(frozen=True, kw_only=True)
class WireFault:
    """One fault."""

    kind: str
    """Of `BY_CHANCE` or `ONCE`."""
    share: float = 0.0
    """Of packets that it strikes by chance [1]."""
    at_s: float = 0.0
    """When it happens, or begins to [s]."""
    lasts_s: float = 0.0
    """How long a silence or an unplugging lasts [s]; 0: for good."""
    motor: int = 0
    """Id of the motor it strikes."""


def parse(text: str) -> WireFault:
    """Read a fault, such as flip=0.05, reset:2@5, or silence@3+0.5.

    Raises:
        ConfigError: it is none.
    """
    found = _FORM.fullmatch(text)
    kind = found["kind"] if found else ""
    try:
        if found and kind in BY_CHANCE and 0 < float(found["share"]) <= 1 and not found["motor"]:
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
        f"use {', '.join(BY_CHANCE)} as in flip=0.05, or "
        f"{', '.join(ONCE)} as in reset:2@5 or silence@3+0.5",
    )


class FaultyBus:
    """An emulated bus whose wire does not keep what it is given.

    Args:
        bus: what is behind the wire.
        now: the time [s].
        faults: what goes wrong.
        seed: of chance.
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
        """Packets that chance has struck so far."""

    def respond(self, data: bytes, baud: int | None = None) -> list[bytes]:
        """Take bytes in, return answers; see `EmulatedBus.respond`."""
        self.happen()
        if self._silent():
            return []
        arrived = b"".join(self._spoilt(packet, request=True) for packet in _packets(data))
        answers = self._bus.respond(arrived, baud)
        now, self._held = self._held, []
        return now + [self._spoilt(answer, request=False) for answer in answers]

    def add(self, fault: WireFault) -> None:
        """Let one more thing go wrong; to unplug is not the wire's."""
        if fault.kind in BY_CHANCE:
            self._chances.append(fault)
        elif fault.kind == "silence":
            self._silences.append(fault)
        elif fault.kind != "unplug":
            self._pending = sorted([*self._pending, fault], key=lambda f: f.at_s)

    def mend(self) -> None:
        """Let nothing more go wrong."""
        for faults in (self._chances, self._silences, self._pending, self._held):
            faults.clear()

    def happen(self) -> None:
        """Let what is due to happen to a motor happen."""
        while self._pending and self._pending[0].at_s <= self._now():
            fault = self._pending.pop(0)
            self.strike(fault.kind, fault.motor)

    def strike(self, kind: str, motor: int) -> None:
        """Let something happen to a motor now: reset, or a hardware error by name."""
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

    def _spoilt(self, packet: bytes, *, request: bool) -> bytes:
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
        place = self._random.randrange(len(packet))
        before, byte, after = packet[:place], packet[place : place + 1], packet[place + 1 :]
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
    """Cut a stream before each header."""
    first, *rest = data.split(HEADER)
    return [part for part in (first, *(HEADER + part for part in rest)) if part]
