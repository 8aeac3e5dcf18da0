"""Eyes without pictures: the exact projection of the target at the exposure, for fast studies."""

from __future__ import annotations

import numpy as np

from endolock.hw.api import Frame, Truth
from endolock.vision.observation import Lock, Observation


class TruthEyes:
    """Eyes that take the target from the ground truth, if it is in the picture and not hidden.

    Args:
        truth: ground truth of the simulation; it must keep the exposures of frames under way.
        noise_px: standard deviation of the noise added to each coordinate [px].
        random: random numbers for the noise; not needed without.
    """

    def __init__(
        self, truth: Truth, noise_px: float = 0.0, random: np.random.Generator | None = None
    ) -> None:
        self._truth = truth
        self._noise_px, self._random = noise_px, random
        self._lock = Lock()

    def __call__(self, frame: Frame) -> Observation:
        """Look up the exposure of a frame."""
        sample = self._truth.at_exposure(frame.seq)
        if not sample.in_picture or sample.hidden:
            return Observation(
                t_capture=frame.t_capture,
                seq=frame.seq,
                status=self._lock.step(False),
                why="target hidden" if sample.in_picture else "target outside the picture",
            )
        return Observation(
            t_capture=frame.t_capture,
            seq=frame.seq,
            status=self._lock.step(True),
            target_px=self._noisy(sample.target_px),
            covariance=(self._noise_px**2, 0.0, self._noise_px**2),
            distance_m=sample.distance_m,
        )

    def _noisy(self, pixel: tuple[float, float]) -> tuple[float, float]:
        if not self._random or not self._noise_px:
            return pixel
        u, v = (pixel + self._noise_px * self._random.standard_normal(2)).tolist()
        return u, v
