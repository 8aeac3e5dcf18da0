"""What changes during a run besides motions: the video chain, and the friction of the wires.

As TOML:

    [[change]]             # the video comes later, and the camera does not know it
    start_s = 60.0
    over_s = 1.0
    latency_s = 0.55

    [[video_gap]]          # no frame arrives
    start_s = 60.0
    over_s = 2.4
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Self

from pydantic import model_validator

from endolock.hw.api import ConfigError
from endolock.hw.strict import bounded
from endolock.twin.world.motion import Event
from endolock.twin.world.scenario_sections import Jitter, Latency, Lost

LARGEST_FRICTION_TIMES = 10.0
"""Largest ratio of the friction to that at the start [1]. Assumed."""


class Change(Event):
    """A permanent change, at constant rate, of each value that is given; the rest stays."""

    latency_s: Latency | None = None
    """Exposure to delivery, from then on [s]."""
    nominal_latency_s: Latency | None = None
    """Latency from which the camera computes the time of exposure, from then on [s]; without it the
    camera does not notice that the latency changes."""
    jitter_s: Jitter | None = None
    """Half width of the uniform variation of the latency, from then on [s]."""
    drop_fraction: Lost | None = None
    """Share of the frames that never arrive, from then on [1]."""
    friction_times: Annotated[float, bounded(0, LARGEST_FRICTION_TIMES)] | None = None
    """Friction of conduits and section, from then on, over that at the start [1]; without wires,
    the width of their plays."""

    @model_validator(mode="after")
    def _changes_something(self) -> Self:
        if not any(getattr(self, name) is not None for name in CHANGED):
            raise ConfigError("changes nothing", f"give one of {', '.join(CHANGED)}")
        return self


class VideoGap(Event):
    """A time in which no frame arrives; those that were due are lost."""

    def holds(self, t: float) -> bool:
        """Whether a frame that is due at time `t` [s] is lost."""
        return self.start_s <= t < self.start_s + self.over_s


CHANGED = tuple(name for name in Change.model_fields if name not in Event.model_fields)
"""What a change can change."""


def value_at(changes: Sequence[Change], name: str, start: float, t: float) -> float:
    """Return a changing value at time `t`.

    Args:
        changes: the changes, in the order in which they start; each begins where the ones before
            have brought the value.
        name: one of `CHANGED`.
        start: the value before them.
        t: time [s].
    """
    value = start
    for change in changes:
        end, part = getattr(change, name), change.done(t)
        if end is not None and part > 0:
            value = end if part == 1 else value + part * (end - value)
    return value


def in_order(changes: Sequence[Change]) -> tuple[Change, ...]:
    """Return changes in the order in which they start."""
    return tuple(sorted(changes, key=lambda change: change.start_s))


def largest(changes: Sequence[Change], name: str, start: float) -> float:
    """Return the largest value that changes ever give; arguments as for `value_at`."""
    ends: list[float | None] = [getattr(change, name) for change in changes]
    return max([start, *(end for end in ends if end is not None)])


def frictions(changes: Sequence[Change]) -> tuple[float, ...]:
    """Return the friction of the start, 1, and what each change makes of it, over that [1]."""
    ends = [change.friction_times for change in changes if change.friction_times is not None]
    return (1.0, *ends)
