"""Finds the printed board by its ArUco markers: target pixel, distance and covariance.

All corners of the markers found give the pose of the board; the target is a point on the board,
projected. With J the derivative of the corners with respect to the pose, J_t that of the target
and s the noise of a corner's coordinate, the target's covariance is s^2 J_t (J^T J)^-1 J_t^T. s^2
is estimated from the misfit of 2n coordinates to 6 parameters.

Reference:
    S. Garrido-Jurado et al., Pattern Recognition 47(6), 2014.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from endolock.hw.api import BoardGeometry, Calibration, Frame, Image, Vector
from endolock.vision import board_pose, refusal
from endolock.vision.board_pose import BoardPose
from endolock.vision.observation import Lock, Observation

MIN_MARKERS = 2
"""A single square leaves its tilt ambiguous, and the target is extrapolated from the tilt."""
CORNER_NOISE_PX = 0.15
"""Least corner noise per coordinate, with sub-pixel refinement [px]: 0.11-0.15 measured."""
MAX_RESIDUAL_PX = 1.5
"""A larger rms misfit of the corners is no picture of this board. Assumed: ten times the noise."""
SMALL_PX = 30.0
"""A region whose largest marker has shorter sides is doubled: small squares are found better."""
MARGIN = 0.35
"""Margin of the region looked at around the last corners, in its own size. Assumed: a board of
100 px moves by less than 35 px from frame to frame in all scenarios but `jump`."""
NOISY = 5.0
"""Smooth a picture with more noise than this [grey levels]: at 20 it would take ten times as
long, for every speck is a candidate."""

Marker = tuple[Vector, int]
"""Corners (4x2 [px]) and id."""


class Fit(NamedTuple):
    """Where a fitted board puts the target."""

    pixel: tuple[float, float]
    covariance: tuple[float, float, float]
    distance_m: float
    pose: BoardPose


class MarkerEyes:
    """Looks for one board in the pictures of one camera, near where it was before.

    Args:
        calibration: the camera's geometry.
        board: what is printed on the board.
    """

    def __init__(self, calibration: Calibration, board: BoardGeometry) -> None:
        self._calibration = calibration
        self._corners = board.corners()
        self.target = np.array([*board.target, 0.0])
        """The point on the board that is reported as the target [m]."""
        self._lock = Lock()
        self._near: list[Marker] = []
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.relativeCornerRefinmentWinSize = 0.8  # 0.3 is the default: twice the error
        # Two window sizes instead of three: a third of the time, no marker less.
        parameters.adaptiveThreshWinSizeMin, parameters.adaptiveThreshWinSizeMax = 5, 15
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
        self._detector = cv2.aruco.ArucoDetector(dictionary, parameters)

    def __call__(self, frame: Frame) -> Observation:
        """Find the board in one frame."""
        found, fit = self.look(frame)
        if isinstance(fit, str):
            return Observation(
                t_capture=frame.t_capture,
                seq=frame.seq,
                status=self._lock.step(False),
                why=fit,
                corners_px=_flat(found),
            )
        return Observation(
            t_capture=frame.t_capture,
            seq=frame.seq,
            status=self._lock.step(True),
            target_px=fit.pixel,
            covariance=fit.covariance,
            distance_m=fit.distance_m,
            corners_px=_flat(found),
        )

    def look(self, frame: Frame) -> tuple[list[Marker], Fit | str]:
        """Find markers in a frame and fit the board to them.

        Returns:
            The markers of the board that were found, and the fit, or why there is none.
        """
        why = refusal.reason(frame, self._calibration)
        if why or frame.image is None:
            self._near = []
            return [], why
        grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)
        if _noise(grey) > NOISY:
            grey = cv2.GaussianBlur(grey, (3, 3), 0)
        if self._near:
            found = self._in_region(np.asarray(grey, np.uint8))
            fit = self.fit(found)
            if len(found) >= len(self._near) and not isinstance(fit, str):
                self._near = found
                return found, fit
        found = self._detect(np.asarray(grey, np.uint8))
        fit = self.fit(found)
        self._near = [] if isinstance(fit, str) else found
        return found, fit

    def fit(self, markers: Sequence[Marker]) -> Fit | str:
        """Fit the board to markers found in a picture; one that does not belong is left out.

        Args:
            markers: what was found.

        Returns:
            Where the target is, or why this is no picture of the board.
        """
        left = list(markers)
        rms = 0.0
        while len(left) >= MIN_MARKERS:
            pixels = np.concatenate([corners for corners, _ in left])
            points = np.concatenate([self._corners[i] for _, i in left])
            pose = board_pose.fit(self._calibration, points, pixels)
            if pose is None:
                return "no board pose fits the markers"
            squared = (pose.misfit**2).sum(axis=1)
            rms = float(np.sqrt(squared.mean()))
            if rms <= MAX_RESIDUAL_PX:
                return self._fit(pose)
            if len(left) == MIN_MARKERS or len(left) < len(markers) - 1:
                break
            worst = int(squared.reshape(-1, 4).sum(axis=1).argmax())
            del left[worst]
        if len(markers) < MIN_MARKERS:
            noun = "marker" if len(markers) == 1 else "markers"
            return f"{len(markers)} {noun} found, {MIN_MARKERS} needed"
        return f"markers misfit the board by {rms:.1f} px rms, {MAX_RESIDUAL_PX} allowed"

    def _fit(self, pose: BoardPose) -> Fit | str:
        seen, pixel, gain = pose.place(self._calibration, self.target)
        if not np.isfinite(pixel).all():
            return "target behind the camera"
        freedom = pose.misfit.size - 6
        noise = max(float((pose.misfit**2).sum()) / freedom, CORNER_NOISE_PX**2)
        spread = noise * gain @ np.linalg.solve(pose.information, gain.T)
        (uu, uv), (_, vv) = spread.tolist()
        u, v = pixel.tolist()
        return Fit((u, v), (uu, uv, vv), float(seen[2]), pose)

    def _in_region(self, grey: Image) -> list[Marker]:
        """Look around the last corners, in twice the size where the markers are small."""
        corners = np.concatenate([corners for corners, _ in self._near])
        low, high = corners.min(axis=0), corners.max(axis=0)
        margin = MARGIN * (high - low).max()
        height, width = grey.shape
        left, top = (max(0, int(c)) for c in low - margin)
        right, bottom = (int(c) for c in high + margin + 1)
        region = grey[top : min(bottom, height), left : min(right, width)]
        sides = max(float(np.linalg.norm(c[1] - c[0])) for c, _ in self._near)
        if sides >= SMALL_PX:
            return [(c + [left, top], i) for c, i in self._detect(region)]
        double = cv2.resize(region, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
        found = self._detect(np.asarray(double, np.uint8))
        return [((c + 0.5) / 2 - 0.5 + [left, top], i) for c, i in found]

    def _detect(self, grey: Image) -> list[Marker]:
        """Markers of this board, each number once: where it occurs twice, neither can be told."""
        found, ids, _ = self._detector.detectMarkers(grey)
        numbers = [] if ids is None else [int(i) for i in ids.ravel()]
        return [
            (np.asarray(corners, np.float64).reshape(4, 2), i)
            for corners, i in zip(found, numbers, strict=True)
            if i in self._corners and numbers.count(i) == 1
        ]


def _flat(markers: Sequence[Marker]) -> tuple[tuple[float, float], ...]:
    return tuple((float(u), float(v)) for corners, _ in markers for u, v in corners)


def _noise(grey: np.ndarray) -> float:
    """Standard deviation of the noise in a picture [grey levels], from some of its rows.

    The median of |second difference| is 0.6745 sqrt(6) times that of white noise; edges are few
    and do not move a median.
    """
    rows = grey[::24].astype(np.int16)
    return float(np.median(np.abs(rows[:, 2:] - 2 * rows[:, 1:-1] + rows[:, :-2]))) / 1.652
