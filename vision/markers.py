"""Finds the printed board by its ArUco markers: target pixel, distance and covariance.

All corners of the markers found give the pose of the board (SQPNP); the target is a point on the
board, projected. With J the derivative of the corners with respect to the pose, J_t that of the
target and s the noise of a corner's coordinate, the target's covariance is
s^2 J_t (J^T J)^-1 J_t^T. s^2 is estimated from the misfit of 2n coordinates to 6 parameters.

Reference:
    S. Garrido-Jurado et al., Pattern Recognition 47(6), 2014; G. Terzakis and M. Lourakis,
    ECCV 2020 (SQPNP).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from endolock.hw.api import BoardGeometry, Calibration, Frame, Vector
from endolock.vision.observation import Lock, Observation

MIN_MARKERS = 2
"""A single square leaves its tilt ambiguous, and the target is extrapolated from the tilt."""
CORNER_NOISE_PX = 0.15
"""Least corner noise per coordinate, with sub-pixel refinement [px]: 0.11-0.15 measured."""
MAX_RESIDUAL_PX = 1.5
"""A larger rms misfit of the corners is no picture of this board. Assumed: ten times the noise."""


class Fit(NamedTuple):
    """Where a fitted board puts the target."""

    pixel: tuple[float, float]
    covariance: tuple[float, float, float]
    distance_m: float


class MarkerEyes:
    """Looks for one board in the pictures of one camera.

    Args:
        calibration: the camera's geometry.
        board: what is printed on the board.
    """

    def __init__(self, calibration: Calibration, board: BoardGeometry) -> None:
        self._calibration, self._matrix = calibration, calibration.matrix
        self._corners = board.corners()
        self._target = np.array([[*board.target, 0.0]])
        self._lock = Lock()
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.relativeCornerRefinmentWinSize = 1.0  # 0.3, the default, is half as accurate
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
        self._detector = cv2.aruco.ArucoDetector(dictionary, parameters)

    def __call__(self, frame: Frame) -> Observation:
        """Find the board in one frame.

        Raises:
            ValueError: the frame carries no picture of the calibrated size.
        """
        wanted = (self._calibration.height, self._calibration.width, 3)
        if frame.image is None or frame.image.shape != wanted:
            got = "no picture" if frame.image is None else f"one of {frame.image.shape}"
            raise ValueError(f"marker detection needs a picture of {wanted}, got {got}")
        grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)
        found, ids, _ = self._detector.detectMarkers(grey)
        own = [
            (np.asarray(corners, np.float64).reshape(4, 2), int(i))
            for corners, i in zip(found, [] if ids is None else ids.ravel(), strict=True)
            if int(i) in self._corners
        ]
        seen = tuple((float(u), float(v)) for corners, _ in own for u, v in corners)
        if len(own) < MIN_MARKERS:
            why = f"{len(own)} of {len(self._corners)} markers found, {MIN_MARKERS} needed"
            return self._missing(frame, why, seen)
        fit = self.fit(own)
        if isinstance(fit, str):
            return self._missing(frame, fit, seen)
        return Observation(
            t_capture=frame.t_capture,
            seq=frame.seq,
            status=self._lock.step(True),
            target_px=fit.pixel,
            covariance=fit.covariance,
            distance_m=fit.distance_m,
            corners_px=seen,
        )

    def fit(self, markers: Sequence[tuple[Vector, int]]) -> Fit | str:
        """Fit the board to markers found in a picture.

        Args:
            markers: corners (4x2 [px]) and id of each; at least `MIN_MARKERS`.

        Returns:
            Where the target is, or why this is no picture of the board.
        """
        pixels = np.concatenate([corners for corners, _ in markers])
        points = np.concatenate([self._corners[i] for _, i in markers])
        ok, rotation, translation = cv2.solvePnP(
            points, pixels, self._matrix, None, flags=cv2.SOLVEPNP_SQPNP
        )
        if not ok:
            return "no board pose fits the markers"
        drawn, jacobian = cv2.projectPoints(points, rotation, translation, self._matrix, None)
        misfit = pixels - drawn.reshape(-1, 2)
        rms = float(np.sqrt((misfit**2).sum(axis=1).mean()))
        if rms > MAX_RESIDUAL_PX:
            return f"markers misfit the board by {rms:.1f} px rms, {MAX_RESIDUAL_PX} allowed"
        target, target_jacobian = cv2.projectPoints(
            self._target, rotation, translation, self._matrix, None
        )
        pose, gain = jacobian[:, :6], target_jacobian[:, :6]
        noise = max(float((misfit**2).sum()) / (misfit.size - 6), CORNER_NOISE_PX**2)
        (uu, uv), (_, vv) = (noise * gain @ np.linalg.solve(pose.T @ pose, gain.T)).tolist()
        u, v = target.ravel().tolist()
        depth = cv2.Rodrigues(rotation)[0] @ self._target[0] + translation.ravel()
        return Fit((u, v), (uu, uv, vv), float(depth[2]))

    def _missing(
        self, frame: Frame, why: str, corners: tuple[tuple[float, float], ...]
    ) -> Observation:
        return Observation(
            t_capture=frame.t_capture,
            seq=frame.seq,
            status=self._lock.step(False),
            why=why,
            corners_px=corners,
        )
