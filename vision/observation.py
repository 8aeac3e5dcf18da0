"""What vision tells the controller about one frame, and how long a lock outlives its target."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from math import nan
from typing import Protocol

from endolock.hw.api import Frame

COAST_FRAMES = 6
"""So many frames in a row without the target keep the lock; then it is lost. Assumed."""


class Status(StrEnum):
    """State of the lock."""

    SEARCHING = "searching"
    """The target has not been seen yet."""
    TRACKING = "tracking"
    """The target was found in this frame."""
    COASTING = "coasting"
    """Not found, but found a few frames ago."""
    LOST = "lost"
    """Not found for more than `COAST_FRAMES` frames."""


@dataclass(frozen=True, kw_only=True)
class Observation:
    """What one frame shows; the position is NaN unless `status` is TRACKING."""

    t_capture: float
    """When the frame was exposed, as the camera believes [s]."""
    seq: int
    """Number of the frame."""
    status: Status
    why: str = ""
    """Why the target was not accepted, in a few words; empty while tracking."""
    target_px: tuple[float, float] = (nan, nan)
    """Target (u, v) [px]; it may lie outside the picture where markers around it are seen."""
    covariance: tuple[float, float, float] = (nan, nan, nan)
    """Its variances and covariance (uu, uv, vv) [px2]."""
    distance_m: float = nan
    """Depth of the target along the optical axis [m]."""
    reference_px: tuple[float, float] = (nan, nan)
    """Where markers around the target say it is [px], for a target followed without them."""
    corners_px: tuple[tuple[float, float], ...] = ()
    """Marker corners found in the frame, for display."""


class Eyes(Protocol):
    """Turns a frame into an observation; called once for every new frame."""

    def __call__(self, frame: Frame) -> Observation:
        """Look at one frame."""


class Lock:
    """Counts frames without the target: SEARCHING -> TRACKING -> COASTING -> LOST -> TRACKING."""

    def __init__(self) -> None:
        self.status = Status.SEARCHING
        """Its present state."""
        self._missed = 0

    def step(self, found: bool) -> Status:
        """Take in whether the newest frame showed the target; return the state of the lock."""
        if found:
            self.status, self._missed = Status.TRACKING, 0
        elif self.status is not Status.SEARCHING:
            self._missed += 1
            self.status = Status.COASTING if self._missed <= COAST_FRAMES else Status.LOST
        return self.status
