"""A progress bar in simulated time; Ctrl-C or a kill ends a run between two ticks."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn


@contextmanager
def closing() -> Iterator[list[int]]:
    """Defer Ctrl-C and kill signals until the rig is closed; yield the list of those received."""
    received: list[int] = []
    in_main_thread = threading.current_thread() is threading.main_thread()
    numbers = (signal.SIGINT, signal.SIGTERM) if in_main_thread else ()
    before = {number: signal.signal(number, lambda n, _: received.append(n)) for number in numbers}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def progress(label: str, duration_s: float, show: bool) -> Iterator[Callable[[float], None]]:
    """Show a progress bar on standard error; yield a function that takes the simulated time [s].

    After a Ctrl-C or a kill the function raises KeyboardInterrupt, so the run ends at a whole tick.
    """
    received: list[int] = []

    def note(number: int, _frame: object) -> None:
        received.append(number)

    in_main_thread = threading.current_thread() is threading.main_thread()
    numbers = (signal.SIGINT, signal.SIGTERM) if in_main_thread else ()
    before = {number: signal.signal(number, note) for number in numbers}
    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.completed:.1f} of {task.total:g} s"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
    )
    try:
        with bar if show else nullcontext():
            task = bar.add_task(label, total=duration_s)

            shown = now = 0.0

            def update(t: float) -> None:
                nonlocal shown, now
                now = t
                if show and now - shown >= 0.2:
                    shown = now
                    bar.update(task, completed=now)
                if received:
                    raise KeyboardInterrupt

            try:
                yield update
            finally:
                bar.update(task, completed=now)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
