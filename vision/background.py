"""The part of a picture that shows the background: all but the board, or a window on the target.

The board is cut out exactly, for any lens: with its pose R, t in the camera, a ray r meets its
plane at b = [R_x R_y t]^-1 r, that is at (b_x/b_z, b_y/b_z) where b_z > 0. It is done for a grid of
points, `COLUMNS` in a row.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from endolock.hw.api import Calibration, Vector
from endolock.vision import camera_model

COLUMNS = 80
"""Number of the grid's points in a row, about."""
KEEP_OFF = 2
"""Least distance of a point of the background from the edges of picture, mask and board, in points
of the grid: the window around it must not show them."""
LEAST_SHARE = 0.06
"""Least share of the visible picture that must be background [1]. Assumed."""
TOO_LITTLE = "the target covers the background"
"""Refusal of a picture with less."""

Mask = NDArray[np.uint8]
"""1 where the grid shows background, else 0; height x width of the grid."""


class Background:
    """Finds the background in pictures of one camera.

    Args:
        calibration: the camera's geometry.
    """

    def __init__(self, calibration: Calibration) -> None:
        self.step_px = max(1, round(calibration.width / COLUMNS))
        """Distance of the grid's points, in both directions [px]."""
        step, middle = self.step_px, self.step_px // 2
        seen = camera_model.visible(calibration)[middle::step, middle::step].astype(np.uint8)
        v, u = np.indices(seen.shape) * step + middle
        rays = camera_model.rays(calibration, np.column_stack([u.ravel(), v.ravel()]))
        ahead = np.isfinite(rays[:, 0])
        self._rays = np.where(ahead[:, None], rays, 0.0)
        self._visible = np.where(ahead.reshape(seen.shape), seen, 0)
        self._kernel = np.ones((2 * KEEP_OFF + 1,) * 2, np.uint8)

    def everything(self) -> Mask:
        """Return the mask of a picture that shows nothing else."""
        return self._inside(self._visible)

    def beside_board(
        self, turned: Vector, centre: Vector, size_m: float, margin_m: float = 0.0
    ) -> Mask:
        """Return the mask of a picture with a square board.

        Args:
            turned: orientation of the board, camera_from_board, 3x3.
            centre: position of its centre in camera axes [m].
            size_m: its side [m].
            margin_m: width of the rim around it that is left out too [m].
        """
        plane = np.column_stack([turned[:, :2], centre])
        if abs(np.linalg.det(plane)) < 1e-9:  # seen exactly from its edge
            return self.everything()
        x, y, z = np.linalg.inv(plane) @ self._rays.T
        far = np.maximum(np.abs(x), np.abs(y))
        covered = (z > 0) & (far < (size_m / 2 + margin_m) * z)
        return self._inside(np.where(covered.reshape(self._visible.shape), 0, self._visible))

    def beside_window(self, pixel: tuple[float, float], half_px: float) -> Mask:
        """Return the mask of a picture with a square window that is left out.

        Args:
            pixel: centre of the window (u, v) [px].
            half_px: half its side [px].
        """
        mask = self._visible.copy()
        corners = np.array([np.subtract(pixel, half_px), np.add(pixel, half_px)]) / self.step_px
        (left, top), (right, bottom) = np.maximum(np.rint(corners), 0).astype(int).tolist()
        mask[top : bottom + 1, left : right + 1] = 0
        return self._inside(mask)

    def share(self, mask: Mask) -> float:
        """Return the share of the visible picture that a mask leaves [1]."""
        return float(mask.sum()) / max(float(self._visible.sum()), 1.0)

    def _inside(self, mask: NDArray[np.generic]) -> Mask:
        """Keep off the edges."""
        open_ = np.asarray(mask, np.uint8)
        return np.asarray(
            cv2.erode(open_, self._kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0), np.uint8
        )
