"""Serves an emulated bus on a pseudo-terminal, at once or as slowly as a wire would."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Protocol

from endolock.hw.emulator.pty_line import PtyLine, sleep_to
from endolock.hw.emulator.servo_model import Servo

BITS = 10
"""Of a byte on the wire: start, eight, stop."""


class AnsweringBus(Protocol):
    """An `EmulatedBus`, or one whose wire has faults."""

    @property
    def servos(self) -> Sequence[Servo]:
        """What is on the line."""

    def respond(self, data: bytes, baud: int | None = None) -> list[bytes]:
        """Take bytes in, return answers."""


class BusServer:
    """A bus at the end of a line.

    Args:
        bus: answers.
        line: where requests come from.
        paced: whether answers take as long as their and the requests' bytes take on a wire.
    """

    def __init__(self, bus: AnsweringBus, line: PtyLine, *, paced: bool = False) -> None:
        self.bus, self.line, self.paced = bus, line, paced

    def answer(self) -> bool:
        """Answer what has come; return whether anything had."""
        data = self.line.read()
        if not data:
            return False
        came = time.monotonic()
        baud = self.line.baud
        answers = self.bus.respond(data, baud)
        if self.paced:
            size = len(data) + sum(map(len, answers))
            delay_s = sum(servo.return_delay_s for servo in self.bus.servos[: len(answers)])
            sleep_to(came + BITS * size / baud + delay_s)
        if answers:
            self.line.write(b"".join(answers))
        return True
