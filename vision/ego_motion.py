"""Rotation of the camera between two pictures, from whatever stands still in the background.

Points are followed from one picture to the next; their rays before and after differ by a rotation,
r' = R r, found by Wahba's problem (SVD) with outliers left out. The camera's translation t is not
modelled: at a distance Z it adds up to |t|/Z, which the covariance does not know. A bending section
moves its tip by about 35 mm a radian, so a background 22 cm away makes the rotation 16 % too large.

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
"""Fewer agree by chance. Assumed."""
SPACING_PX = 14
BACKWARD_PX = 0.7
"""A point that comes back farther than this from where it started was lost [px]."""
EDGE_PX = 12
"""Nearest to the edge of what is visible [px]: the mask's rim does not move."""
OUTLIER = 2.5
"""Leave out what misfits by more than so many medians."""
NOISE_PX = 0.05
"""Least noise of a followed point [px]. Assumed."""


class Rotation(NamedTuple):
    """How the camera turned since the frame before."""

    seq: int
    """Of the later frame."""
    since: int
    """Of the earlier frame."""
    vector: Vector
    """Axis times angle in camera axes (right, down, ahead) [rad]: of the camera, not the scene."""
    covariance: Vector
    """3x3 [rad2]."""
    points: int
    """So many agreed."""


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
        """Compare a frame with the one given before.

        Args:
            frame: the newest frame.
            moving: corners, n x 2 [px], of a region that does not belong to the background; its
                convex hull is left out.

        Returns:
            The rotation, or why there is none.
        """
        why = refusal.reason(frame, self._calibration)
        if why or frame.image is None:
            return why
        grey = grey_of(frame.image)
        before, self._before = self._before, (frame.seq, grey)
        if before is None:
            return "no frame before"
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
        # The scene turns by R as the camera sees it, so the camera turns by its inverse.
        vector = -np.asarray(cv2.Rodrigues(turn)[0], np.float64).ravel()
        return Rotation(seq, since, vector, noise * np.linalg.inv(information), count)


def _wahba(before: Vector, after: Vector) -> Vector:
    """Rotation that turns the rays before into those after with the least squares."""
    left, _, right = np.linalg.svd(after.T @ before)
    sign = np.sign(np.linalg.det(left @ right))
    turn: Vector = left @ np.diag([1.0, 1.0, sign]) @ right
    return turn
