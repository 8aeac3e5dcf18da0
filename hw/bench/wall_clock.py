"""Wall-clock time since a rig was created."""

from __future__ import annotations

import time


class WallClock:
    """The clock of a bench.

    Args:
        origin: reading of `time.monotonic()` at time zero [s]; now if None. Processes on one
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
        """Return at `t` [s], or at once if it has passed; slightly late, never early."""
        while (left := t - self.now()) > 0:
            time.sleep(left)
        return self.now()
