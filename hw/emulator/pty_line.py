"""The emulator's end of a serial line: a pseudo-terminal that clients open like a port.

A pty has no wire: bytes arrive at once and undamaged, its baud rate has no effect, and root can
open it even if it is exclusive.
"""

from __future__ import annotations

import os
import select
import sys
import time
from pathlib import Path

from endolock.hw.api import ConfigError
from endolock.hw.files import replacing

if sys.platform != "linux":
    raise ConfigError("the emulated serial line needs Linux", "run it there, or use --rig twin")

import tty

from endolock.hw.dynamixel.linux_port import baud_of


class PtyLine:
    """One line, plugged in from the start.

    Args:
        link: symbolic link to the client's end, which gives it a fixed name; none if None.

    Raises:
        ConfigError: the link cannot be made.
    """

    path: str
    """Path of the client's end: the link, if there is one."""

    def __init__(self, link: Path | None = None) -> None:
        self._link = link
        self._name = ""
        self._master = -1
        self.path = ""
        self.plug_in()

    @property
    def plugged(self) -> bool:
        """Whether clients can open it."""
        return self._master >= 0

    @property
    def baud(self) -> int:
        """Baud rate set by the client [1/s]."""
        return baud_of(self._master)

    def fileno(self) -> int:
        """Return the descriptor for select and poll; -1 while unplugged."""
        return self._master

    def plug_in(self) -> None:
        """Make a new line; it has a new name, and the link is set to it."""
        self.unplug()
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self.path = self._name = os.ttyname(slave)
        os.close(slave)  # for the client to open; until then poll reports a hang-up
        self._master = master
        if self._link is not None:
            try:
                self._point(self._name, self._link)
            except ConfigError:
                self.unplug()
                raise
            self.path = str(self._link)

    def unplug(self) -> None:
        """Unplug it: clients see a hang-up."""
        if self._master >= 0:
            os.close(self._master)
            self._master = -1

    def read(self) -> bytes:
        """Return the bytes received; none where nothing was sent or no client has opened it."""
        try:
            return os.read(self._master, 4096)
        except OSError:  # nothing received, or no client
            return b""

    def write(self, data: bytes) -> None:
        """Send to the client; without one the bytes are lost, as on a wire."""
        try:
            while data:
                data = data[os.write(self._master, data) :]
        except OSError:
            return

    def wait(self, timeout_s: float) -> bool:
        """Wait for bytes; return whether there may be some. Without a client, only wait."""
        if self._master < 0:
            time.sleep(timeout_s)
            return False
        readable, _, _ = select.select([self._master], [], [], timeout_s)
        if not readable:
            return False
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        if any(flags & select.POLLIN for _, flags in poll.poll(0)):
            return True
        time.sleep(min(timeout_s, 0.005))  # no client has it open, and poll cannot wait for one
        return False

    def close(self) -> None:
        """Unplug and remove the link, unless it points elsewhere by now; may be called twice."""
        self.unplug()
        link, self._link = self._link, None
        if link is not None and link.is_symlink() and str(link.readlink()) == self._name:
            link.unlink()

    @staticmethod
    def _point(name: str, link: Path) -> None:
        if link.exists() and not link.is_symlink():
            raise ConfigError(f"{link} exists and is not a link", "give another --link")
        with replacing(link, "give another --link") as part:
            part.unlink(missing_ok=True)
            part.symlink_to(name)
