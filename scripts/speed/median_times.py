"""Time calls so that a busy moment of the machine affects all of them alike."""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median

REPEAT = 7
"""Repetitions of one call, unless stated."""


def median_times(
    *calls: Callable[[], object], repeat: int = REPEAT, warm_up: bool = False
) -> tuple[float, ...]:
    """Return the median time of each call [s]; the calls are made in turns.

    Args:
        calls: what to time.
        repeat: number of repetitions of each call.
        warm_up: whether to make each call once before, untimed.
    """
    if warm_up:
        for call in calls:
            call()
    taken: list[list[float]] = [[] for _ in calls]
    for _ in range(repeat):
        for call, times in zip(calls, taken, strict=True):
            start = time.perf_counter()
            call()
            times.append(time.perf_counter() - start)
    return tuple(median(times) for times in taken)
