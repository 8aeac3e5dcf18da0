"""Serial ports of Linux.

A port excludes other programs (flock and TIOCEXCL), supports any baud rate, tells an unplugged
adapter from a silent one, and finds it again under another name. VMIN = 1 together with O_NONBLOCK
makes an empty read a hang-up and nothing else.
"""

from __future__ import annotations

import errno
import os
import select
import struct
import sys
from pathlib import Path

from endolock.hw.api import ConfigError, PortBusy, PortGone
from endolock.hw.dynamixel.port import BY_ID, gone

if sys.platform != "linux":
    raise ConfigError("this serial port is for Linux", "use endolock.hw.dynamixel.port.serial_port")

import fcntl
import termios
import tty

_PTYS = range(136, 144)
"""Major device numbers of pseudo-terminals."""
# struct termios2 of asm-generic/termbits.h, which holds any baud rate; not on MIPS and PowerPC.
_TERMIOS2 = struct.Struct("4IB19s2I")
_TCGETS2, _TCSETS2, _BOTHER = 0x802C542A, 0x402C542B, 0o010000


def set_any_baud(fd: int, baud: int) -> None:
    """Set both directions of a terminal to any baud rate [1/s]."""
    fields = list(_TERMIOS2.unpack(fcntl.ioctl(fd, _TCGETS2, bytes(_TERMIOS2.size))))
    fields[2] = fields[2] & ~termios.CBAUD & ~(termios.CBAUD << 16) | _BOTHER
    fields[6] = fields[7] = baud
    fcntl.ioctl(fd, _TCSETS2, _TERMIOS2.pack(*fields))


def baud_of(fd: int) -> int:
    """Return the baud rate of a terminal [1/s]."""
    rate: int = _TERMIOS2.unpack(fcntl.ioctl(fd, _TCGETS2, bytes(_TERMIOS2.size)))[7]
    return rate


def _plain(fd: int) -> None:
    """Reset what others may have set: no flow control, one stop bit, no modem lines."""
    fields = termios.tcgetattr(fd)
    fields[2] |= termios.CLOCAL | termios.CREAD
    fields[2] &= ~(termios.CSTOPB | termios.CRTSCTS)
    termios.tcsetattr(fd, termios.TCSANOW, fields)


class SerialPort:
    """A serial port of Linux, held by one program at a time.

    Args:
        path: device file, or a link to one, such as in /dev/serial/by-id.
        baud: baud rate [1/s].
        by_id: folder of persistent names; the one of the device is used to find it again.
    """

    def __init__(self, path: str | Path, baud: int, by_id: Path = BY_ID) -> None:
        self._path, self._baud, self._by_id = Path(path), baud, by_id
        self._persistent: Path | None = None
        self._fd = -1
        self._poll = select.poll()

    @property
    def name(self) -> str:
        """Its name, for messages."""
        return str(self._path)

    def open(self) -> None:
        """Open it, or open it again; see `Port.open`."""
        self.close()
        path = self._find()
        flags = os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC
        try:
            fd = os.open(path, flags)
        except OSError as error:
            raise self._refused(error) from None
        try:
            # The lock excludes programs that ask for it, TIOCEXCL all others (but not root). A pty
            # would stay exclusive if we were killed.
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.major(os.fstat(fd).st_rdev) not in _PTYS:
                fcntl.ioctl(fd, termios.TIOCEXCL)
            tty.setraw(fd)  # VMIN = 1, VTIME = 0
            _plain(fd)
            set_any_baud(fd, self._baud)
            termios.tcflush(fd, termios.TCIOFLUSH)
        except (OSError, termios.error) as error:
            os.close(fd)
            raise self._refused(OSError(*error.args)) from None
        self._persistent = self._persistent or self._named()
        self._fd = fd
        self._poll = select.poll()
        self._poll.register(fd, select.POLLIN)

    def set_baud(self, baud: int) -> None:
        """Change the baud rate; see `Port.set_baud`."""
        self._baud = baud
        try:
            set_any_baud(self._fd, baud)
        except (OSError, ValueError):  # ValueError: it is closed
            raise gone(str(self._path)) from None

    def send(self, data: bytes) -> None:
        """Write all bytes; see `Port.send`."""
        try:
            while data:
                data = data[self._push(data) :]
        except OSError:
            raise gone(str(self._path)) from None

    def receive(self, timeout_s: float) -> bytes:
        """Return what was received; see `Port.receive`."""
        try:
            if self._fd >= 0 and not self._poll.poll(max(0.0, 1e3 * timeout_s)):
                return b""
            data = os.read(self._fd, 4096)
        except OSError:
            raise gone(str(self._path)) from None
        if not data:
            raise gone(str(self._path))
        return data

    def close(self) -> None:
        """Close it."""
        if self._fd >= 0:
            fd, self._fd = self._fd, -1
            # Closing alone leaves it exclusive if another process has inherited it.
            try:
                fcntl.ioctl(fd, termios.TIOCNXCL)
            except OSError:
                pass  # it was unplugged
            finally:
                os.close(fd)

    def _push(self, data: bytes) -> int:
        try:
            return os.write(self._fd, data)
        except BlockingIOError:  # full
            select.select([], [self._fd], [], 1.0)
            return os.write(self._fd, data)

    def _find(self) -> Path:
        """Return its present path: its persistent name, if it has one."""
        if self._persistent is not None and self._persistent.exists():
            return self._persistent
        return self._path

    def _named(self) -> Path | None:
        if not self._by_id.is_dir():
            return None
        here = self._path.resolve()
        return next((p for p in sorted(self._by_id.iterdir()) if p.resolve() == here), None)

    def _refused(self, error: OSError) -> Exception:
        path = self._path
        if error.errno in (errno.ENOTTY, errno.EISDIR):
            return ConfigError(
                f"{path} is not a serial port ({error.strerror})", "list them with endolock doctor"
            )
        if error.errno in (errno.EAGAIN, errno.EBUSY):
            return PortBusy(
                f"{path} is in use by another program",
                "close that program",
                recovery=("connect",),
                t=0.0,
            )
        if isinstance(error, PermissionError):
            return ConfigError(f"no permission to open {path}", "see endolock doctor")
        return PortGone(
            f"{path} cannot be opened ({error.strerror})",
            "plug it in, and see endolock doctor",
            t=0.0,
        )
