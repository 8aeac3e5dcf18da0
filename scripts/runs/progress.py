"""A progress bar in simulated time, and a Ctrl-C or kill that ends a run between two ticks."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn


@contextmanager
def closing() -> Iterator[list[int]]:
    """Let no Ctrl-C or kill get between a run and the closing of its rig; list those that came."""
    asked: list[int] = []
    listening = threading.current_thread() is threading.main_thread()
    asking = (signal.SIGINT, signal.SIGTERM) if listening else ()
    before = {number: signal.signal(number, lambda n, _: asked.append(n)) for number in asking}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def progress(label: str, duration_s: float, show: bool) -> Iterator[Callable[[float], None]]:
    """Show a bar on standard error; Ctrl-C, or a kill, ends the run at the next whole tick."""
    asked: list[int] = []

    def ask(number: int, _frame: object) -> None:
        asked.append(number)

    listening = threading.current_thread() is threading.main_thread()
    asking = (signal.SIGINT, signal.SIGTERM) if listening else ()
    before = {number: signal.signal(number, ask) for number in asking}
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

            def tell(t: float) -> None:
                nonlocal shown, now
                now = t
                if show and now - shown >= 0.2:
                    shown = now
                    bar.update(task, completed=now)
                if asked:
                    raise KeyboardInterrupt

            try:
                yield tell
            finally:
                bar.update(task, completed=now)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
