"""Eyes that find the printed board by its ArUco markers: target pixel, distance and covariance.

The pose of the board is fitted to all corners of the markers found, and the target, a point on the
board, is projected. With J the derivative of the corners by the pose, J_t that of the target, and s
the noise of a corner coordinate, the covariance of the target is s^2 J_t (J^T J)^-1 J_t^T. s^2 is
estimated from the residuals of 2n coordinates with 6 parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import cv2
import numpy as np

from endolock.hw.api import BoardGeometry, Calibration, Frame, Image
from endolock.vision import board_pose, camera_model, refusal
from endolock.vision.board_pose import BoardPose
from endolock.vision.detector import Marker, MarkerDetector
from endolock.vision.ego_motion import LEVER_M
from endolock.vision.grey import grey_of, smoothed
from endolock.vision.observation import Lock, Observation
from endolock.vision.turning import Turning

MIN_MARKERS = 2
"""Fewest markers: the tilt of a single square is ambiguous, and so is the extrapolated target."""
CORNER_NOISE_PX = 0.15
"""Least corner noise per coordinate, with sub-pixel refinement [px]: 0.11-0.15 measured."""
MAX_RESIDUAL_PX = 1.5
"""Largest rms residual of the corners [px]; with more the board is refused. Assumed: ten times the
noise."""
SMALL_PX = 30.0
"""Least side of the largest marker in a region [px]; smaller regions are enlarged twofold, in which
small squares are found better."""
MARGIN = 0.35
"""Margin of the region that is searched around the last corners, relative to its size. Assumed: a
board of 100 px moves by less than 35 px between frames in all scenarios but `jump`."""

MIRRORED = "mirrored: the camera's picture is flipped; switch that off where the picture is made"
"""Refusal of a picture in which the board's markers are seen in a mirror."""


class BoardFit(NamedTuple):
    """A fitted board: target pixel, covariance (uu, uv, vv) [px2] and depth [m], and pose."""

    pixel: tuple[float, float]
    covariance: tuple[float, float, float]
    distance_m: float
    pose: BoardPose


class MarkerEyes:
    """Eyes that find one board by its markers, first near its last position.

    Args:
        calibration: geometry of the camera.
        board: geometry of the board.
        lever_m: distance from the camera to the point about which the section turns it [m].
    """

    def __init__(
        self, calibration: Calibration, board: BoardGeometry, lever_m: float = LEVER_M
    ) -> None:
        self._calibration = calibration
        self._corners = board.corners()
        self.target = np.array([*board.target, 0.0])
        """The point on the board that is reported as the target [m]."""
        self._lock = Lock()
        self._near: list[Marker] = []
        self._detect = MarkerDetector(board)
        self.turning = Turning(calibration, board.size_m, lever_m)
        """Measures the rotation of the camera beside the board."""

    def __call__(self, frame: Frame) -> Observation:
        """Find the board in one frame."""
        found, fit = self.look(frame)
        turn = self.turning(frame, None if isinstance(fit, str) else fit.pose)
        if isinstance(fit, str):
            return Observation(
                t_capture=frame.t_capture,
                seq=frame.seq,
                status=self._lock.step(False),
                why=fit,
                corners_px=_flat(found),
                turn=turn,
            )
        return Observation(
            t_capture=frame.t_capture,
            seq=frame.seq,
            status=self._lock.step(True),
            target_px=fit.pixel,
            covariance=fit.covariance,
            distance_m=fit.distance_m,
            corners_px=_flat(found),
            turn=turn,
        )

    def look(self, frame: Frame) -> tuple[list[Marker], BoardFit | str]:
        """Find markers in a frame and fit the board to them.

        Returns:
            The markers of the board that were found, and the fit, or the reason why there is none.
        """
        why = refusal.reason(frame, self._calibration)
        if why or frame.image is None:
            self._near = []
            return [], why
        grey = smoothed(grey_of(frame.image))
        if self._near:
            found = self._in_region(grey)
            fit = self.fit(found)
            if len(found) >= len(self._near) and not isinstance(fit, str):
                self._near = found
                return found, fit
        found, mirrored = self._detect.look(grey)
        fit = MIRRORED if mirrored >= max(MIN_MARKERS, len(found) + 1) else self.fit(found)
        self._near = [] if isinstance(fit, str) else found
        return found, fit

    def fit(self, markers: Sequence[Marker]) -> BoardFit | str:
        """Fit the board to markers found in a picture; false markers are left out.

        Args:
            markers: the markers found.

        Returns:
            The fit, or the reason why the board is not accepted.
        """
        if len(markers) < MIN_MARKERS:
            noun = "marker" if len(markers) == 1 else "markers"
            return f"{len(markers)} {noun} found, {MIN_MARKERS} needed"
        rms, pose = self._pose(markers)
        if rms > MAX_RESIDUAL_PX:
            left = self._consensus(markers)
            if max(MIN_MARKERS, len(markers) / 2) <= len(left) < len(markers):
                rms, pose = self._pose(left)
        if pose is None:
            return "no board pose fits the markers"
        if rms > MAX_RESIDUAL_PX:
            return f"markers misfit the board by {rms:.1f} px rms, {MAX_RESIDUAL_PX} allowed"
        return self._fit(pose)

    def _consensus(self, markers: Sequence[Marker]) -> list[Marker]:
        """Leave out markers that do not lie in one plane with most of the others."""
        pixels = np.concatenate([corners for corners, _ in markers])
        points = np.concatenate([self._corners[i] for _, i in markers])
        rays = camera_model.rays(self._calibration, pixels)
        if not np.isfinite(rays).all():
            return list(markers)
        flat = np.ascontiguousarray(self._calibration.focal_px * rays[:, :2])
        near = 2 * MAX_RESIDUAL_PX  # the largest residual of a corner is about twice the rms
        _, agree = cv2.findHomography(points[:, :2], flat, cv2.RANSAC, near)
        if agree is None:
            return list(markers)
        whole = [bool(corners.all()) for corners in np.reshape(agree, (-1, 4))]
        return [marker for marker, good in zip(markers, whole, strict=True) if good]

    def _pose(self, markers: Sequence[Marker]) -> tuple[float, BoardPose | None]:
        """Fit a pose to all markers; return its rms residual [px], infinite without one, and it."""
        pixels = np.concatenate([corners for corners, _ in markers])
        points = np.concatenate([self._corners[i] for _, i in markers])
        pose = board_pose.fit(self._calibration, points, pixels)
        if pose is None:
            return inf, None
        return float(np.sqrt((pose.misfit**2).sum(axis=1).mean())), pose

    def _fit(self, pose: BoardPose) -> BoardFit | str:
        seen, pixel, gain = pose.locate(self._calibration, self.target)
        if not np.isfinite(pixel).all():
            return "target behind the camera"
        freedom = pose.misfit.size - 6
        noise = max(float((pose.misfit**2).sum()) / freedom, CORNER_NOISE_PX**2)
        spread = noise * gain @ np.linalg.solve(pose.information, gain.T)
        (uu, uv), (_, vv) = spread.tolist()
        u, v = pixel.tolist()
        return BoardFit((u, v), (uu, uv, vv), float(seen[2]), pose)

    def _in_region(self, grey: Image) -> list[Marker]:
        """Detect markers around the last corners, enlarged twofold if they are small."""
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


def _flat(markers: Sequence[Marker]) -> tuple[tuple[float, float], ...]:
    return tuple((float(u), float(v)) for corners, _ in markers for u, v in corners)
