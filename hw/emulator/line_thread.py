"""Answers a line from a thread of its own: a bus does not wait for pictures to be drawn."""

from __future__ import annotations

from collections.abc import Callable
from threading import Event, Lock, Thread

from endolock.hw.emulator.bus_server import BusServer

WAIT_S = 0.005
"""Longest time without a look at plug and end [s]."""


class LineThread:
    """Serves one line until it is closed.

    Args:
        server: answers the line's requests.
        turn: held while it does, as whoever else changes the servos has to hold it.
        plug: called now and then: plugs the line in or out, where that is due.
    """

    def __init__(self, server: BusServer, turn: Lock, plug: Callable[[], None]) -> None:
        self._server, self._turn, self._plug = server, turn, plug
        self._end = Event()
        self._error: Exception | None = None
        self._thread = Thread(target=self._run, name="line", daemon=True)
        self._thread.start()

    def check(self) -> None:
        """Raise the error that has ended the thread, if there is one."""
        if self._error is not None:
            raise self._error

    def close(self) -> None:
        """End the thread; may be called twice."""
        self._end.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            while not self._end.is_set():
                self._plug()
                if self._server.line.wait(WAIT_S):
                    with self._turn:
                        self._server.answer()
        except Exception as error:  # for the thread that checks
            self._error = error
