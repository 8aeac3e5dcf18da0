"""Stops on Ctrl-C and `kill`: between two ticks, or within a law or eyes that hang.

The first signal ends a run at the end of the tick. A second one interrupts a law or eyes at once;
without a second one this happens after `GRACE_S`, to whatever the run waits for then. While a rig
or a run folder is being closed signals are only noted. A law that cannot be interrupted either, as
it calls a library that does not return or catches all exceptions, is abandoned: the handles hold
and are switched off, the log is closed, and the process ends.
"""

from __future__ import annotations

import _thread
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from endolock.control import user_code

GRACE_S = 2.0
"""Time for a tick to end after the first signal, and then for an interrupted law [s]. Assumed: a
hundred periods."""
INTERRUPTED = 130
"""Exit code of an interrupted program."""
SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stop:
    """What signals asked for, and what they may interrupt."""

    def __init__(self) -> None:
        self.asked = False
        """Whether a signal came."""
        self.interruptible = False
        """Whether a signal well after the first may interrupt any code, not only a law or eyes."""
        self.abandon: Callable[[], None] | None = None
        """Makes the handles safe and closes the log while a law does not return."""
        self._asked_at = 0.0
        self.over = threading.Event()
        """Set when all is closed."""
        self.sending = threading.Lock()
        """Held while a signal is sent on behalf of an earlier one."""

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal came."""
        if self.asked:
            self.interruptible = False  # what follows is closing
            raise KeyboardInterrupt

    def note(self, _number: int, frame: FrameType | None) -> None:
        """Take note of a signal, as its handler; interrupt with the second one."""
        now = time.monotonic()
        if not self.asked:
            self.asked, self._asked_at = True, now
            return
        waits = self.interruptible and now - self._asked_at >= GRACE_S / 2
        if waits or user_code.is_running(frame):
            self.interruptible = False
            raise KeyboardInterrupt


@contextmanager
def closing() -> Iterator[Stop]:
    """Defer Ctrl-C and kill signals until all is closed; yield what they ask for.

    In other threads than the main one, where signals do not arrive, it does nothing.
    """
    stop = Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = {number: signal.signal(number, stop.note) for number in SIGNALS}
    ours, theirs = socket.socketpair()
    theirs.setblocking(False)
    woken = signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=_insist, args=(stop, ours), daemon=True).start()
    try:
        yield stop
        stop.check()
    finally:
        with stop.sending:  # no signal of the thread may come after this
            signal.set_wakeup_fd(woken)  # first, as the thread closes the other end
            stop.over.set()
        for number, handler in before.items():
            signal.signal(number, handler)
        theirs.close()  # ends the thread


def _insist(stop: Stop, signals: socket.socket) -> None:
    """After a signal see to it that the run ends; in a thread, as the main one may hang.

    Args:
        stop: what signals asked for.
        signals: sends a byte for each signal, and ends with the run.
    """
    main, sent = threading.main_thread().ident, False
    assert main is not None
    with signals:  # open to the end, as further signals send bytes too
        if not signals.recv(1):
            return
        while not stop.over.wait(GRACE_S):
            with stop.sending:
                hangs = user_code.is_running(sys._current_frames().get(main))
                if stop.over.is_set():
                    return
                if sent and hangs and stop.abandon:
                    _abandon(stop.abandon)
                if not sent and (hangs or stop.interruptible):
                    sent = True
                    _interrupt(main)


def _interrupt(main: int) -> None:
    """Send a second signal to the main thread."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(main, signal.SIGINT)  # ends a sleep as well
    else:
        _thread.interrupt_main()


def _abandon(make_safe: Callable[[], None]) -> None:
    """End the process in spite of a law that does not return."""
    with suppress(Exception):  # whatever fails, the process ends
        make_safe()
    said = "endolock: interrupted; the law did not stop, so it was abandoned"
    print(f"\n{said}", file=sys.stderr, flush=True)
    os._exit(INTERRUPTED)
