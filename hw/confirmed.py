"""Readings that confirm each other: a single one never becomes a goal or a zero.

A servo may report a wrong position with a good checksum, once or twice in a row. So what a handle
is sent to comes from five readings, of which the last three in succession agree with each other
and with the speed limit:

    |x_i - x_j| <= v |t_i - t_j| + SLACK steps of the encoder.

The median of the five is taken: as long as at most two are wrong, by however much, it lies between
right ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import nan
from typing import NamedTuple

NEEDED = 3
"""Successive readings that have to agree."""
KEPT = 5
"""Readings whose median is taken: two wrong ones are outvoted."""
SLACK = 2.0
"""Distance at which two readings of a handle at rest still agree [steps]: it may stand between two
steps, and a reading may be off by one. Assumed."""


class Sample(NamedTuple):
    """One reading of one axis."""

    t: float
    """[s]"""
    at: float
    """Position, in any unit."""
    goal: float = nan
    """The goal in force, in the same unit; nan where torque is off."""


def agree(samples: Sequence[Sample], speed: float, step: float) -> bool:
    """Return whether these agree with each other and with a speed.

    Args:
        samples: of one axis.
        speed: largest speed [unit/s].
        step: one step of the encoder [unit].
    """
    return all(
        abs(a.at - b.at) <= speed * abs(a.t - b.t) + SLACK * step
        for a, b in combinations(samples, 2)
    )


def median(samples: Sequence[Sample]) -> Sample:
    """Return the sample in the middle, by position."""
    return sorted(samples, key=lambda sample: sample.at)[(len(samples) - 1) // 2]


def majority(samples: Sequence[Sample], speed: float, step: float) -> float | None:
    """Return the median position if at least `NEEDED` samples agree with it; or None."""
    if not samples:
        return None
    middle = median(samples)
    near = [sample for sample in samples if agree((middle, sample), speed, step)]
    return middle.at if len(near) >= NEEDED else None


def confirmed(samples: Sequence[Sample], speed: float, step: float) -> float | None:
    """Return the median of the last `KEPT` if the last `NEEDED` agree with it and each other."""
    if len(samples) < KEPT:
        return None
    last = list(samples)[-KEPT:]
    middle = median(last)
    return middle.at if agree([middle, *last[-NEEDED:]], speed, step) else None
