"""Holding still: the handles keep the angles that they have when the lock is switched on.

Its score is the cost of doing nothing; a controller with a worse score is worse than none.
"""

from __future__ import annotations

from dataclasses import dataclass

from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Calibration, Command, State
from endolock.vision.observation import Observation


@dataclass(frozen=True, kw_only=True)
class StillSettings:
    """No settings."""


@dataclass
class StillMemory:
    """State of the controller."""

    goals: Pair = (0.0, 0.0)
    """Angles at which the handles are held [rad]."""


class Still:
    """Holds the handles.

    Args:
        calibration: not used; all controllers are made from one.
        settings: not used.
    """

    def __init__(self, calibration: Calibration, settings: StillSettings | None = None) -> None:
        self.memory = StillMemory()

    def reset(self, state: State) -> None:
        """Hold the handles at their present goals."""
        self.memory = StillMemory(goals=(state.goal[0], state.goal[1]))

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Hold; see `Controller.update`."""
        return Command(position=self.memory.goals)
