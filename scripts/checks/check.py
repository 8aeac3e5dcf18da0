"""The record of a check, and the decorator that adds one to a list."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf


@dataclass(frozen=True, kw_only=True)
class Check:
    """One comparison of the twin with a reference."""

    what: str
    against: str
    unit: str
    low: float = -inf
    high: float = inf
    """Bounds of the figure."""
    why: str
    """Reason for the bounds."""
    measure: Callable[[], float]
    """Returns the figure: the worst deviation, unless `what` says otherwise."""


def check(
    into: list[Check],
    what: str,
    *,
    against: str,
    unit: str,
    low: float = -inf,
    high: float = inf,
    why: str,
) -> Callable[[Callable[[], float]], Callable[[], float]]:
    """Add the decorated function to a list of checks; the other arguments are those of `Check`."""

    def note(measure: Callable[[], float]) -> Callable[[], float]:
        into.append(
            Check(
                what=what, against=against, unit=unit, low=low, high=high, why=why, measure=measure
            )
        )
        return measure

    return note
