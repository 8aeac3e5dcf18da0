"""A serial port of Windows and macOS, through pyserial; the extra `serial` installs it."""

from __future__ import annotations

from pathlib import Path

from endolock.hw.api import ConfigError, PortBusy, PortGone
from endolock.hw.dynamixel.port import gone

try:
    import serial
except ModuleNotFoundError:
    raise ConfigError(
        "serial ports need pyserial on this system",
        "install it with pip install 'endolock[serial]'",
    ) from None


class PortablePort:
    """A serial port of any system; see `port.Port`.

    Args:
        path: its name, such as COM3 or /dev/cu.usbserial-1.
        baud: baud rate [1/s].
    """

    def __init__(self, path: str | Path, baud: int) -> None:
        self.name = str(path)
        self._baud = baud
        self._port: serial.Serial | None = None

    def open(self) -> None:
        """Open it, or open it again."""
        self.close()
        try:
            self._port = serial.Serial(self.name, self._baud, timeout=0, exclusive=True)
        except serial.SerialException as error:
            said = " ".join(str(error).split())
            busy = "Access is denied" in said or "exclusively lock" in said
            if busy:
                raise PortBusy(
                    f"{self.name} is in use by another program",
                    "close that program",
                    recovery=("connect",),
                    t=0.0,
                ) from None
            if "Could not configure port" in said:
                raise ConfigError(
                    f"{self.name} is not a serial port ({said})", "list them with endolock doctor"
                ) from None
            raise PortGone(
                f"{self.name} cannot be opened ({said})",
                "plug it in, and see endolock doctor",
                t=0.0,
            ) from None

    def set_baud(self, baud: int) -> None:
        """Change the baud rate [1/s]."""
        self._baud = baud
        try:
            self._open.baudrate = baud
        except (serial.SerialException, OSError):
            raise gone(self.name) from None

    def send(self, data: bytes) -> None:
        """Write all bytes."""
        try:
            self._open.write(data)
        except (serial.SerialException, OSError):
            raise gone(self.name) from None

    def receive(self, timeout_s: float) -> bytes:
        """Return what was received; wait at most this time for the first byte [s]."""
        try:
            port = self._open
            port.timeout = max(0.0, timeout_s)
            first: bytes = port.read(max(1, port.in_waiting))
            return first + port.read(port.in_waiting) if first else first
        except (serial.SerialException, OSError, TypeError):  # TypeError: closed meanwhile
            raise gone(self.name) from None

    def close(self) -> None:
        """Close it; may be called twice."""
        if self._port is not None:
            self._port.close()
            self._port = None

    @property
    def _open(self) -> serial.Serial:
        if self._port is None:
            raise gone(self.name)
        return self._port
