"""Serves an emulated bus on a pseudo-terminal, at once or at the speed of a wire."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from endolock.hw.dynamixel.port import BITS
from endolock.hw.emulator.emulated_bus import AnsweringBus

if TYPE_CHECKING:
    from endolock.hw.emulator.pty_line import PtyLine

SPIN_S = 2e-4
"""The last part of a wait is spent polling the clock [s]; the system wakes late."""


class BusServer:
    """Answers the requests on a line with a bus.

    Args:
        bus: answers.
        line: delivers requests.
        paced: whether answers are delayed by the time that all bytes take on a wire.
    """

    def __init__(self, bus: AnsweringBus, line: PtyLine, *, paced: bool = False) -> None:
        self.bus, self.line, self.paced = bus, line, paced

    def answer(self) -> bool:
        """Answer the bytes received; return whether there were any."""
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
