"""Numbers kept in memory while a run goes on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from endolock.hw.api import Vector

CHUNK = 16384
"""Numbers per chunk. An array that grows is moved again and again, and leaves holes in memory."""


class Numbers:
    """A growing list of floats, 8 bytes each."""

    def __init__(self) -> None:
        self._chunks: list[Vector] = []
        self._used = CHUNK

    def append(self, *values: float) -> None:
        """Append numbers."""
        for value in values:
            if self._used == CHUNK:
                self._chunks.append(np.empty(CHUNK))
                self._used = 0
            self._chunks[-1][self._used] = value
            self._used += 1

    def all(self) -> Vector:
        """Return all numbers, n."""
        if not self._chunks:
            return np.empty(0)
        return np.concatenate([*self._chunks[:-1], self._chunks[-1][: self._used]])


class Travel:
    """Range and length of a path of several coordinates, each by itself."""

    def __init__(self) -> None:
        self._last: Vector | None = None

    def append(self, point: Sequence[float]) -> None:
        """Go on to a point."""
        here = np.array(point, float)
        if self._last is None:
            self._low = self._high = here
            self._length = np.zeros_like(here)
        else:
            self._low, self._high = np.minimum(self._low, here), np.maximum(self._high, here)
            self._length = self._length + np.abs(here - self._last)
        self._last = here

    @property
    def moved(self) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
        """Peak to peak, and distance travelled, of each coordinate; None without a point."""
        if self._last is None:
            return None
        return tuple((self._high - self._low).tolist()), tuple(self._length.tolist())
