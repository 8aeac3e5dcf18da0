"""What Ctrl-C and `kill` do to a command outside of a run, which has rules of its own.

While libraries are imported nothing is open, and an exception within an import may end anywhere:
the process ends at once. Afterwards the first signal raises KeyboardInterrupt, and what comes while
the command closes its rig and its files is ignored.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

import endolock

CLOSING_S = 10.0
"""For this time after an interruption further signals are ignored [s]. Assumed: the longest time in
which a rig closes, that of an emulated bench whose server does not answer."""
SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def interrupted_once() -> Iterator[None]:
    """Raise KeyboardInterrupt at the first signal, and not again while that one has its effect."""
    before = -CLOSING_S

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        nonlocal before
        now = time.monotonic()
        if now - before >= CLOSING_S:
            before = now
            raise KeyboardInterrupt

    with _handled(interrupt):
        yield


@contextmanager
def ended_at_once() -> Iterator[None]:
    """End the process at the first signal, in one line; for imports."""
    with _handled(endolock._end_at_once):
        yield


@contextmanager
def _handled(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield  # signals do not arrive here
        return
    before = {number: signal.signal(number, handler) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler_before in before.items():
            signal.signal(number, handler_before)
