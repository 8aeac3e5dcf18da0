"""A port connected to an emulated bus in the same process: no line, no waiting, no randomness."""

from __future__ import annotations

from endolock.hw.api import PortGone
from endolock.hw.dynamixel.port import DEFAULT_BAUD
from endolock.hw.emulator.emulated_bus import AnsweringBus
from endolock.hw.errors import RESUME


class Loopback:
    """A port without a line; see `port.Port`. Answers come at once or never: it never waits.

    Args:
        bus: the bus at the other end.
        baud: baud rate of this end [1/s].
    """

    name = "loopback"

    def __init__(self, bus: AnsweringBus, baud: int = DEFAULT_BAUD) -> None:
        self._bus, self._baud = bus, baud
        self._coming = bytearray()
        self.plugged = True
        """Whether the bus is connected."""

    def open(self) -> None:
        """Open it; see `Port.open`."""
        if not self.plugged:
            raise PortGone("loopback cannot be opened", "plug it in", t=0.0)
        self._coming.clear()

    def set_baud(self, baud: int) -> None:
        """Change the baud rate of this end [1/s]."""
        self._baud = baud

    def send(self, data: bytes) -> None:
        """Send all bytes; the answers can then be received."""
        self._check()
        for answer in self._bus.respond(data, self._baud):
            self._coming += answer

    def receive(self, timeout_s: float) -> bytes:
        """Return what was received."""
        self._check()
        data = bytes(self._coming)
        self._coming.clear()
        return data

    def close(self) -> None:
        """Nothing to do."""

    def _check(self) -> None:
        if not self.plugged:
            raise PortGone("loopback is gone", "plug it in again", recovery=RESUME, t=0.0)
