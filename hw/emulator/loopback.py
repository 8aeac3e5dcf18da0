"""A port that ends in an emulated bus in the same process: no line, no waiting, no chance."""

from __future__ import annotations

from endolock.hw.api import PortGone
from endolock.hw.dynamixel.port import BAUD
from endolock.hw.emulator.emulated_bus import AnsweringBus
from endolock.hw.errors import RESUME


class Loopback:
    """See `hw.port.Port`. What is not answered at once never is, so a time-out takes no time.

    Args:
        bus: at the other end.
        baud: of this end [1/s].
    """

    name = "loopback"

    def __init__(self, bus: AnsweringBus, baud: int = BAUD) -> None:
        self._bus, self._baud = bus, baud
        self._coming = bytearray()
        self.plugged = True
        """Whether there is anything at the other end."""

    def open(self) -> None:
        """Get hold of the bus; see `Port.open`."""
        if not self.plugged:
            raise PortGone("loopback cannot be opened", "plug it in", t=0.0)
        self._coming.clear()

    def set_baud(self, baud: int) -> None:
        """Change the baud rate of this end [1/s]."""
        self._baud = baud

    def send(self, data: bytes) -> None:
        """Write all bytes, and have them answered."""
        self._check()
        for answer in self._bus.respond(data, self._baud):
            self._coming += answer

    def receive(self, timeout_s: float) -> bytes:
        """Return what has come."""
        self._check()
        data = bytes(self._coming)
        self._coming.clear()
        return data

    def close(self) -> None:
        """Let go of it."""

    def _check(self) -> None:
        if not self.plugged:
            raise PortGone("loopback is gone", "plug it in again", recovery=RESUME, t=0.0)
