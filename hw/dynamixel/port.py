"""Serial ports: what a bus needs of one, and which kind this system has."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Protocol

BAUD = 1_000_000
"""Default baud rate of a bench; `endolock doctor --set-up` sets motors to it [1/s]."""
BITS = 10
"""Bits of one byte on the wire: start, eight, stop."""
BY_ID = Path("/dev/serial/by-id")
"""Where Linux names ports by what is plugged in."""


class Port(Protocol):
    """A line of bytes to a bus."""

    @property
    def name(self) -> str:
        """What people call it."""

    def open(self) -> None:
        """Get hold of it, also after it has gone.

        Raises:
            PortBusy: another program has it.
            PortGone: there is none.
        """

    def set_baud(self, baud: int) -> None:
        """Change the baud rate of the open port [1/s]."""

    def send(self, data: bytes) -> None:
        """Write all bytes.

        Raises:
            PortGone: it was unplugged.
        """

    def receive(self, timeout_s: float) -> bytes:
        """Return what has come, waiting for the first byte so long [s]; nothing if none came.

        Raises:
            PortGone: it was unplugged.
        """

    def close(self) -> None:
        """Let go of it; may be called twice."""


def serial_port(path: str | Path, baud: int) -> Port:
    """Return a port that is not open yet: ours on Linux, pyserial's elsewhere.

    Raises:
        ConfigError: pyserial is needed and not installed.
    """
    if sys.platform == "linux":
        from endolock.hw.dynamixel.linux_port import SerialPort

        return SerialPort(path, baud)
    from endolock.hw.dynamixel.portable_port import PortablePort

    return PortablePort(path, baud)
