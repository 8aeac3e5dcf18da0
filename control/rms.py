"""Root of the mean square."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from endolock.hw.api import Vector


def rms(values: Vector | Sequence[float]) -> float:
    """Return the root of the mean square of all values, in their unit."""
    return float(np.sqrt(np.mean(np.square(values))))
