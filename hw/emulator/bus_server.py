"""Serves an emulated bus on a pseudo-terminal, at once or as slowly as a wire would."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from endolock.hw.dynamixel.port import BITS
from endolock.hw.emulator.emulated_bus import AnsweringBus

if TYPE_CHECKING:
    from endolock.hw.emulator.pty_line import PtyLine

SPIN_S = 2e-4
"""The rest of a wait is spent looking at the clock [s]; the system wakes late."""


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


def sleep_to(deadline: float) -> None:
    """Return at a reading of `time.monotonic()` [s], to some microseconds."""
    left = deadline - time.monotonic()
    if left > SPIN_S:
        time.sleep(left - SPIN_S)
    while time.monotonic() < deadline:
        pass
