"""Eyes without pictures: the exact projection of the target at the exposure, for fast studies."""

from __future__ import annotations

import numpy as np

from endolock.hw import rotation
from endolock.hw.api import Calibration, Frame, Plant, Pose, Truth
from endolock.vision.background import LEAST_SHARE, Background
from endolock.vision.observation import Lock, Observation, Turn

TURN_NOISE_RAD, TURN_NOISE_SHARE = 2e-5, 0.008
"""Noise of each part of a rotation between frames [rad], and its growth with the rotation [1].
Source: measured on rendered pictures, docs/vision.md."""
TURN_SCALE = 0.998
"""Ratio of a measured rotation to the true one [1]. Source: measured on rendered pictures,
docs/vision.md."""


class TrueTurns:
    """Rotations of the camera with the noise of those measured on pictures, and where they are.

    Args:
        calibration: the camera's geometry.
        size_m: side of the square board, which covers the background [m].
        random: random numbers for the noise.
    """

    def __init__(
        self, calibration: Calibration, size_m: float, random: np.random.Generator
    ) -> None:
        self._background = Background(calibration)
        self._size_m, self._random = size_m, random
        self._before: tuple[float, Pose] | None = None

    def __call__(self, frame: Frame, plant: Plant) -> Turn | None:
        """Measure the rotation since the last frame that showed a background.

        Args:
            frame: the newest frame.
            plant: the truth at its exposure.
        """
        noise = self._random.standard_normal(3)  # always, so that the others stay the same
        if frame.repeated or not self._open(plant):
            return None
        before, self._before = self._before, (frame.t_capture, plant.tip)
        if before is None or frame.t_capture <= before[0]:
            return None
        w, x, y, z = before[1].quaternion
        exact = rotation.to_vector(rotation.product((w, -x, -y, -z), plant.tip.quaternion))
        std = TURN_NOISE_RAD + TURN_NOISE_SHARE * float(np.linalg.norm(exact))
        x, y, z = (TURN_SCALE * np.array(exact) + std * noise).tolist()
        var = std**2
        return Turn(
            since_s=before[0],
            vector=(x, y, z),
            covariance=((var, 0.0, 0.0), (0.0, var, 0.0), (0.0, 0.0, var)),
        )

    def _open(self, plant: Plant) -> bool:
        """Whether enough of the picture shows background, as `EgoMotion` asks for."""
        back = plant.tip.matrix.T
        centre = back @ np.subtract(plant.board.position, plant.tip.position)
        mask = self._background.beside_board(back @ plant.board.matrix, centre, self._size_m)
        return self._background.share(mask) >= LEAST_SHARE


class TruthEyes:
    """Eyes that take the target from the ground truth, if it is in the picture and not hidden.

    Args:
        truth: ground truth of the simulation; it must keep the exposures of frames under way.
        noise_px: standard deviation of the noise added to each coordinate [px].
        random: random numbers for the noise; not needed without.
        turns: measures the rotations of the camera; without it there are none.
    """

    def __init__(
        self,
        truth: Truth,
        noise_px: float = 0.0,
        random: np.random.Generator | None = None,
        turns: TrueTurns | None = None,
    ) -> None:
        self._truth = truth
        self._noise_px, self._random = noise_px, random
        self._turns = turns
        self._lock = Lock()

    def __call__(self, frame: Frame) -> Observation:
        """Look up the exposure of a frame."""
        sample = self._truth.at_exposure(frame.seq)
        turn = self._turns(frame, sample.plant) if self._turns else None
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

    def _noisy(self, pixel: tuple[float, float]) -> tuple[float, float]:
        if not self._random or not self._noise_px:
            return pixel
        u, v = (pixel + self._noise_px * self._random.standard_normal(2)).tolist()
        return u, v
