"""The clock of a simulated rig: sleeping on it advances the simulation."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from typing import Protocol

from endolock.hw.api import ConfigError
from endolock.twin.arguments import CLOSED


class Stepped(Protocol):
    """What has a time."""

    @property
    def t(self) -> float:
        """Present time [s]."""


class SimulatedClock:
    """Simulated time on a grid.

    Args:
        plant: has the present time.
        timestep_s: grid of the simulation [s].
        advance: called with the grid point to advance to.
    """

    realtime = False

    def __init__(self, plant: Stepped, timestep_s: float, advance: Callable[[int], None]) -> None:
        self._plant, self.timestep_s, self._advance = plant, timestep_s, advance

    def now(self) -> float:
        """Return the time since the rig was created [s]."""
        return self._plant.t

    def sleep_until(self, t: float) -> float:
        """Advance to the first grid point at or after `t` [s] and return its time.

        Raises:
            ConfigError: the rig is closed.
        """
        self._advance(ceil(t / self.timestep_s - 1e-6))
        return self.now()

    def stop(self) -> None:
        """Let go of the rig, so that a closed rig is freed with the last reference to it."""
        self._advance = _refuse


def _refuse(_step: int) -> None:
    raise ConfigError(*CLOSED)
