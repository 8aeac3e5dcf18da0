"""Time per tick of each controller, in the loop on the surrogate."""

from __future__ import annotations

import time
from functools import lru_cache

import numpy as np

from endolock.control import loop, registry
from endolock.control.loop import Controller
from endolock.hw.api import Command, State, Vector
from endolock.twin.surrogate import SurrogateRig
from endolock.twin.world.fitted_plays import plays_of
from endolock.twin.world.instrument import Instrument
from endolock.vision.observation import Observation
from endolock.vision.truth_eyes import TruthEyes

DURATION_S = 40.0
"""Simulated time, enough for the identification of the predictive controllers [s]."""
STROKE_S = 8.6
"""Period of `straight` [s]."""


class TimedController:
    """Wraps a controller and times its ticks.

    Args:
        controller: the controller.
    """

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self.taken: list[float] = []
        """Time of each tick [s]."""

    def reset(self, state: State) -> None:
        """Reset the controller."""
        self._controller.reset(state)

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Update the controller."""
        start = time.perf_counter()
        command = self._controller.update(t, state, observation)
        self.taken.append(time.perf_counter() - start)
        return command


def mean() -> dict[str, float]:
    """Mean time of a tick of each controller [ms]."""
    return {name: 1e3 * float(taken.mean()) for name, taken in _taken().items()}


def p99() -> dict[str, float]:
    """99th percentile of the time per tick of each controller [ms]."""
    return {name: 1e3 * float(np.percentile(taken, 99)) for name, taken in _taken().items()}


@lru_cache(maxsize=1)
def _taken() -> dict[str, Vector]:
    plays = plays_of(Instrument(), 180.0)
    result = {}
    for name in sorted(registry.LAWS):
        settings = registry.configure(name, known={"period_s": STROKE_S, "plays": plays})
        with SurrogateRig("straight", transmission=plays) as rig:
            timed = TimedController(
                registry.make(name, rig.camera.calibration, settings, rig.truth)
            )
            loop.run(rig, TruthEyes(rig.truth), timed, duration_s=DURATION_S)
        result[name] = np.array(timed.taken)
    return result
