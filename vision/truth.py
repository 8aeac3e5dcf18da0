"""Vision without pictures: the target's exact projection at the exposure, for fast studies."""

from __future__ import annotations

from endolock.hw.api import Frame, Truth
from endolock.vision.observation import Lock, Observation


class TruthEyes:
    """Takes the target of each frame from the truth, where it lies within the picture.

    Args:
        truth: the simulation's truth; it must remember the exposures still under way.
    """

    def __init__(self, truth: Truth) -> None:
        self._truth = truth
        self._lock = Lock()

    def __call__(self, frame: Frame) -> Observation:
        """Look the exposure up."""
        sample = self._truth.at_exposure(frame.seq)
        if not sample.in_picture:
            return Observation(
                t_capture=frame.t_capture,
                seq=frame.seq,
                status=self._lock.step(False),
                why="target outside the picture",
            )
        return Observation(
            t_capture=frame.t_capture,
            seq=frame.seq,
            status=self._lock.step(True),
            target_px=sample.target_px,
            covariance=(0.0, 0.0, 0.0),
            distance_m=sample.distance_m,
        )
