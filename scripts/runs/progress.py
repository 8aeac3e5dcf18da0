"""A progress bar in simulated time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from endolock.scripts.runs.stopping import Stop


@contextmanager
def progress(
    label: str, duration_s: float, show: bool, stop: Stop
) -> Iterator[Callable[[float], None]]:
    """Show a progress bar on standard error; yield a function that takes the simulated time [s].

    After a Ctrl-C or a kill the function raises KeyboardInterrupt, so the run ends at a whole tick.

    Args:
        label: text before the bar.
        duration_s: simulated time of the whole bar [s].
        show: whether to show it.
        stop: what signals ask for; within this context a late one interrupts any code.
    """
    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.completed:.1f} of {task.total:g} s"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
    )
    with bar if show else nullcontext():
        task = bar.add_task(label, total=duration_s)

        shown = now = 0.0

        def update(t: float) -> None:
            nonlocal shown, now
            now = t
            if show and now - shown >= 0.2:
                shown = now
                bar.update(task, completed=now)
            stop.check()

        stop.interruptible = True
        try:
            yield update
        finally:
            stop.interruptible = False
            bar.update(task, completed=now)
