"""Time of a bench: that of the wall, counted from when the rig was made."""

from __future__ import annotations

import time


class WallClock:
    """A clock that nobody can stop.

    Args:
        origin: reading of `time.monotonic()` that counts as zero [s]; now if None. Processes on one
            machine that share it agree on the time.
    """

    realtime = True
    timestep_s = 0.0

    def __init__(self, origin: float | None = None) -> None:
        self.origin = time.monotonic() if origin is None else origin

    def now(self) -> float:
        """Time since the origin [s]."""
        return time.monotonic() - self.origin

    def sleep_until(self, t: float) -> float:
        """Return at `t` [s], or at once if it has passed; a little late, never early."""
        while (left := t - self.now()) > 0:
            time.sleep(left)
        return self.now()
