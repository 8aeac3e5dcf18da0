"""Holding still: the handles stay where they are when the lock is switched on.

What it scores is what doing nothing costs; a law that does worse is worse than none.
"""

from __future__ import annotations

from dataclasses import dataclass

from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Calibration, Command, State
from endolock.vision.observation import Observation


@dataclass(frozen=True, kw_only=True)
class StillSettings:
    """There is nothing to set."""


@dataclass
class StillMemory:
    """What the law remembers."""

    handles: Pair = (0.0, 0.0)
    """Where the handles are held [rad]."""


class Still:
    """Holds the handles, whatever is seen.

    Args:
        calibration: not used; every law is made from one.
        settings: not used.
    """

    def __init__(self, calibration: Calibration, settings: StillSettings | None = None) -> None:
        self.memory = StillMemory()

    def reset(self, state: State) -> None:
        """Hold where the handles are."""
        self.memory = StillMemory(handles=(state.position[0], state.position[1]))

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Hold; see `Controller.update`."""
        return Command(position=self.memory.handles)
