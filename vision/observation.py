"""The result of vision for one frame, and the state of the lock."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from math import nan
from typing import Protocol

from endolock.hw.api import Frame

COAST_FRAMES = 6
"""Number of successive frames without the target after which the lock is lost. Assumed."""
BLIND_S = 2.0
"""Without a new frame for longer than this [s] the video has stopped: the lock is lost, and the
handles hold until a frame comes. Assumed: more than twice the longest latency in use."""


class Status(StrEnum):
    """State of the lock."""

    SEARCHING = "searching"
    """The target has not been seen yet."""
    TRACKING = "tracking"
    """The target was found in this frame."""
    COASTING = "coasting"
    """The target was not found, but at most `COAST_FRAMES` frames ago."""
    LOST = "lost"
    """The target was not found for more than `COAST_FRAMES` frames."""


@dataclass(frozen=True, kw_only=True)
class Turn:
    """Rotation of the camera between two frames, measured on what does not move."""

    since_s: float
    """Estimated time of exposure of the earlier frame [s]; the later one is the observation's."""
    vector: tuple[float, float, float]
    """Rotation vector of the camera, not of the scene, in its axes (right, down, ahead) [rad]."""
    covariance: tuple[
        tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]
    ]
    """Covariance of the vector [rad2]."""


@dataclass(frozen=True, kw_only=True)
class Observation:
    """What vision found in one frame; `target_px` is NaN unless `status` is TRACKING."""

    t_capture: float
    """Time of exposure as estimated by the camera [s]."""
    seq: int
    """Number of the frame."""
    status: Status
    why: str = ""
    """Reason why the target was not accepted; empty while tracking."""
    target_px: tuple[float, float] = (nan, nan)
    """Target (u, v) [px]; it may lie outside the picture where markers around it are seen."""
    covariance: tuple[float, float, float] = (nan, nan, nan)
    """Covariance of the target (uu, uv, vv) [px2]."""
    distance_m: float = nan
    """Depth of the target along the optical axis [m]."""
    reference_px: tuple[float, float] = (nan, nan)
    """Target position from the markers around it [px], if it is tracked without them."""
    corners_px: tuple[tuple[float, float], ...] = ()
    """Marker corners found in the frame, for display."""
    turn: Turn | None = None
    """Rotation of the camera since an earlier frame, by the background; None where there is no
    background, or too little of it."""


class Eyes(Protocol):
    """Turns a frame into an observation; called once for every new frame."""

    def __call__(self, frame: Frame) -> Observation:
        """Look at one frame."""


class Lock:
    """The lock as a state machine: SEARCHING -> TRACKING -> COASTING -> LOST -> TRACKING."""

    def __init__(self) -> None:
        self.status = Status.SEARCHING
        """Present state of the lock."""
        self._missed = 0

    def step(self, found: bool) -> Status:
        """Update with whether the newest frame showed the target; return the state of the lock."""
        if found:
            self.status, self._missed = Status.TRACKING, 0
        elif self.status is not Status.SEARCHING:
            self._missed += 1
            self.status = Status.COASTING if self._missed <= COAST_FRAMES else Status.LOST
        return self.status
