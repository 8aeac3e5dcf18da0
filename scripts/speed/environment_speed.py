"""Speed of the Gymnasium environments."""

from __future__ import annotations

import os
from importlib.util import find_spec

import numpy as np

from endolock.scripts.speed.median_times import median_times


def available() -> bool:
    """Whether Gymnasium is installed."""
    return find_spec("gymnasium") is not None


def environments() -> dict[str, float]:
    """Measure steps per second of one Gymnasium environment, and of one process per core.

    No pictures are rendered; a step is 20 ms.
    """
    import gymnasium  # optional

    from endolock.twin.env import gym_env

    count = os.cpu_count() or 1
    single, several = gymnasium.make(gym_env.STATE_ID), gym_env.vector(count)
    actions = np.full((count, 2), 0.1, np.float32)

    def one() -> None:
        for _ in range(100):
            single.step(actions[0])

    def all_of_them() -> None:
        for _ in range(100):
            several.step(actions)

    try:
        single.reset(seed=0)
        several.reset(seed=0)
        one_s, all_s = median_times(one, all_of_them)
    finally:
        single.close()
        several.close()
    return {
        "steps_per_s": 100 / one_s,
        "vector_steps_per_s": 100 * count / all_s,
        "environments": count,
    }
