"""Rotation of the camera between two pictures, from the static background.

Points are followed from one picture to the next; their rays before and after differ by a rotation,
r' = R r, the solution of Wahba's problem (SVD) without outliers. The translation t of the camera
is not modelled: at a distance Z it adds an error of up to |t|/Z, which the covariance does not
include. A bending section moves its tip by about 35 mm per radian, so with a background at 22 cm
the rotation is 16 % too large.

Reference:
    F. L. Markley, J. Astronaut. Sci. 36(3), 1988 (attitude by SVD).
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from endolock.hw.api import Calibration, Frame, Image, Vector
from endolock.vision import camera_model, refusal
from endolock.vision.grey import grey_of

POINTS = 150
MIN_POINTS = 12
"""Fewest points; fewer may agree by chance. Assumed."""
SPACING_PX = 14
BACKWARD_PX = 0.7
"""Largest forward-backward distance of a followed point [px]."""
EDGE_PX = 12
"""Least distance from the edge of the visible part [px]: the rim of the mask does not move."""
OUTLIER = 2.5
"""Largest residual of an inlier, in medians of the residuals."""
NOISE_PX = 0.05
"""Least noise of a followed point [px]. Assumed."""


class Rotation(NamedTuple):
    """Rotation of the camera since the previous frame."""

    seq: int
    """Number of the later frame."""
    since: int
    """Number of the earlier frame."""
    vector: Vector
    """Rotation vector of the camera, not of the scene, in axes (right, down, ahead) [rad]."""
    covariance: Vector
    """3x3 [rad2]."""
    points: int
    """Number of inliers."""


class EgoMotion:
    """Measures the rotation from each frame to the next.

    Args:
        calibration: the camera's geometry.
    """

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration
        open_ = camera_model.visible(calibration).astype(np.uint8)
        self._open = cv2.erode(
            open_, np.ones((2 * EDGE_PX + 1,) * 2, np.uint8), borderValue=0
        ).astype(np.uint8)
        self._before: tuple[int, Image] | None = None

    def __call__(self, frame: Frame, moving: Vector | None = None) -> Rotation | str:
        """Compare a frame with the previous one.

        Args:
            frame: the newest frame.
            moving: corners, n x 2 [px], of a region that is not background; its convex hull is
                ignored.

        Returns:
            The rotation, or the reason why there is none.
        """
        why = refusal.reason(frame, self._calibration)
        if why or frame.image is None:
            return why
        grey = grey_of(frame.image)
        before, self._before = self._before, (frame.seq, grey)
        if before is None:
            return "no previous frame"
        since, earlier = before
        return self._compare(since, earlier, frame.seq, grey, moving)

    def _compare(
        self, since: int, earlier: Image, seq: int, grey: Image, moving: Vector | None
    ) -> Rotation | str:
        mask = self._open
        if moving is not None and len(moving) > 2:
            mask = mask.copy()
            cv2.fillConvexPoly(mask, cv2.convexHull(np.rint(moving).astype(np.int32)), 0)
        start = cv2.goodFeaturesToTrack(earlier, POINTS, 0.01, SPACING_PX, mask=mask)
        if start is None or len(start) < MIN_POINTS:
            return "background has too little texture"
        ends, ok, _ = cv2.calcOpticalFlowPyrLK(earlier, grey, start, np.empty(0), maxLevel=3)
        back, ok_back, _ = cv2.calcOpticalFlowPyrLK(grey, earlier, ends, np.empty(0), maxLevel=3)
        apart = np.linalg.norm((back - start).reshape(-1, 2), axis=1)
        good = (ok.ravel() > 0) & (ok_back.ravel() > 0) & (apart < BACKWARD_PX)
        pixels = (start.reshape(-1, 2)[good], ends.reshape(-1, 2)[good])
        rays = [camera_model.rays(self._calibration, p.astype(np.float64)) for p in pixels]
        a, b = (r / np.linalg.norm(r, axis=1, keepdims=True) for r in rays)
        kept = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
        for _ in range(4):
            if kept.sum() < MIN_POINTS:
                return f"{int(kept.sum())} points of the background followed, {MIN_POINTS} needed"
            turn = _wahba(a[kept], b[kept])
            off = np.linalg.norm(b - a @ turn.T, axis=1)
            kept = off <= OUTLIER * max(float(np.median(off[kept])), 1e-9)
        # b = R a: a small error w of R moves b by w x b, so the information is sum(1 - b b').
        count = int(kept.sum())
        angle_px = 1 / self._calibration.focal_px
        noise = max(float((off[kept] ** 2).sum()) / (2 * count - 3), (NOISE_PX * angle_px) ** 2)
        information = count * np.eye(3) - b[kept].T @ b[kept]
        # The scene turns by R as seen by the camera, so the camera turns by its inverse.
        vector = -np.asarray(cv2.Rodrigues(turn)[0], np.float64).ravel()
        return Rotation(seq, since, vector, noise * np.linalg.inv(information), count)


def _wahba(before: Vector, after: Vector) -> Vector:
    """Return the rotation that maps the rays before to those after, by least squares."""
    left, _, right = np.linalg.svd(after.T @ before)
    sign = np.sign(np.linalg.det(left @ right))
    turn: Vector = left @ np.diag([1.0, 1.0, sign]) @ right
    return turn
