"""Eyes without pictures: the exact projection of the target at the exposure, for fast studies."""

from __future__ import annotations

import numpy as np

from endolock.hw import rotation
from endolock.hw.api import Frame, Pose, Truth
from endolock.vision.observation import Lock, Observation, Turn

TURN_NOISE_RAD, TURN_NOISE_SHARE = 2e-4, 0.02
"""Noise of a rotation between frames [rad], and its growth with the rotation [1]. Assumed."""
TURN_SCALE = 1.03
"""Ratio of a measured rotation to the true one [1]. Assumed."""


class TruthEyes:
    """Eyes that take the target from the ground truth, if it is in the picture and not hidden.

    Args:
        truth: ground truth of the simulation; it must keep the exposures of frames under way.
        noise_px: standard deviation of the noise added to each coordinate [px].
        random: random numbers for the noise; not needed without.
        turns: random numbers for the noise of the rotations; without them none are measured.
    """

    def __init__(
        self,
        truth: Truth,
        noise_px: float = 0.0,
        random: np.random.Generator | None = None,
        turns: np.random.Generator | None = None,
    ) -> None:
        self._truth = truth
        self._noise_px, self._random = noise_px, random
        self._turns = turns
        self._before: tuple[float, Pose] | None = None
        self._lock = Lock()

    def __call__(self, frame: Frame) -> Observation:
        """Look up the exposure of a frame."""
        sample = self._truth.at_exposure(frame.seq)
        turn = self._turn(frame.t_capture, sample.plant.tip)
        if not sample.in_picture or sample.hidden:
            return Observation(
                t_capture=frame.t_capture,
                seq=frame.seq,
                status=self._lock.step(False),
                why="target hidden" if sample.in_picture else "target outside the picture",
                turn=turn,
            )
        return Observation(
            t_capture=frame.t_capture,
            seq=frame.seq,
            status=self._lock.step(True),
            target_px=self._noisy(sample.target_px),
            covariance=(self._noise_px**2, 0.0, self._noise_px**2),
            distance_m=sample.distance_m,
            turn=turn,
        )

    def _turn(self, t_capture: float, tip: Pose) -> Turn | None:
        """Measure the rotation since the previous frame, with noise; it is repeatable by seed."""
        before, self._before = self._before, (t_capture, tip)
        if self._turns is None or before is None or t_capture <= before[0]:
            return None
        earlier = before[1].quaternion
        inverse = (earlier[0], -earlier[1], -earlier[2], -earlier[3])
        exact = np.array(rotation.to_vector(rotation.product(inverse, tip.quaternion)))
        std = TURN_NOISE_RAD + TURN_NOISE_SHARE * float(np.linalg.norm(exact))
        x, y, z = (TURN_SCALE * exact + std * self._turns.standard_normal(3)).tolist()
        var = std**2
        return Turn(
            since_s=before[0],
            vector=(x, y, z),
            covariance=((var, 0.0, 0.0), (0.0, var, 0.0), (0.0, 0.0, var)),
        )

    def _noisy(self, pixel: tuple[float, float]) -> tuple[float, float]:
        if not self._random or not self._noise_px:
            return pixel
        u, v = (pixel + self._noise_px * self._random.standard_normal(2)).tolist()
        return u, v
