"""Independent random numbers for each source of noise, from one seed."""

from __future__ import annotations

import numpy as np


def generator(seed: int, source: str) -> np.random.Generator:
    """Make the generator of one noise source; it does not depend on which other sources are on.

    Args:
        seed: seed of the run, >= 0.
        source: name of the noise source, for example "camera.jitter".
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=tuple(source.encode())))
