"""Serial ports: the interface that a bus needs, and the port of this system."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Protocol

from endolock.hw.errors import RESUME, PortGone

DEFAULT_BAUD = 1_000_000
"""Default baud rate of a bench; `endolock doctor --set-up` sets motors to it [1/s]."""
BITS = 10
"""Bits of one byte on the wire: start, eight, stop."""
BY_ID = Path("/dev/serial/by-id")
"""Folder in which Linux names ports by the adapter."""


class Port(Protocol):
    """A line of bytes to a bus."""

    @property
    def name(self) -> str:
        """Its name, for messages."""

    def open(self) -> None:
        """Open it, or open it again after it was unplugged.

        Raises:
            PortBusy: another program has it.
            PortGone: it does not exist.
        """

    def set_baud(self, baud: int) -> None:
        """Change the baud rate of the open port [1/s]."""

    def send(self, data: bytes) -> None:
        """Write all bytes.

        Raises:
            PortGone: it was unplugged.
        """

    def receive(self, timeout_s: float) -> bytes:
        """Return what was received; wait at most this time for the first byte [s].

        Raises:
            PortGone: it was unplugged.
        """

    def close(self) -> None:
        """Close it; may be called twice."""


def serial_port(path: str | Path, baud: int) -> Port:
    """Return a port that is not open yet: our own on Linux, that of pyserial elsewhere.

    Raises:
        ConfigError: pyserial is needed and not installed.
    """
    if sys.platform == "linux":
        from endolock.hw.dynamixel.linux_port import SerialPort

        return SerialPort(path, baud)
    from endolock.hw.dynamixel.portable_port import PortablePort

    return PortablePort(path, baud)


def gone(name: str) -> PortGone:
    """Return the error for a port that was unplugged.

    Args:
        name: of the port.
    """
    return PortGone(
        f"{name} is gone; the motors hold where they are, by their own watchdog",
        "plug it in again",
        recovery=RESUME,
        t=0.0,
    )
