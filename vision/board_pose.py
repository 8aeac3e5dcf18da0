"""Pose of a board from corners found in a picture: SQPNP, then least squares in pixels.

If the noise of all corners is the same in pixels, the pose with the least sum of squared pixel
residuals is the most likely one, for a fisheye too. SQPNP gives the initial pose.

Reference:
    G. Terzakis and M. Lourakis, ECCV 2020 (SQPNP).
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from endolock.hw.api import Calibration, Vector
from endolock.vision import camera_model

STEPS = 2
"""Gauss-Newton steps; the first comes within 1e-3 px of the optimum. Source: measured."""


class BoardPose(NamedTuple):
    """A fitted pose with its residuals and information."""

    rotation: Vector
    """3x3, camera_from_board."""
    translation: Vector
    """Position of the board's centre in camera axes [m]."""
    misfit: Vector
    """Residuals, pixel found minus pixel expected, n x 2 [px]."""
    information: Vector
    """J^T J, 6x6, for small rotations about the camera axes and translations."""

    def locate(self, calibration: Calibration, point: Vector) -> tuple[Vector, Vector, Vector]:
        """Return the position and the pixel of a point of the board.

        Args:
            calibration: the camera.
            point: (x, y, z) on the board [m].

        Returns:
            The point in camera axes [m], its pixel, and the derivative of the pixel, 2x6, with
            respect to rotation and translation.
        """
        seen = self.rotation @ point + self.translation
        pixel = np.array(camera_model.project(calibration, seen))
        return seen, pixel, _chain(calibration, (seen - self.translation)[None], seen[None])[0]

    def under(self, ray: Vector) -> Vector:
        """Return where a ray (x/z, y/z, 1) meets the plane of the board, in board axes [m]."""
        start = -self.rotation.T @ self.translation
        direction = self.rotation.T @ ray
        point: Vector = start - start[2] / direction[2] * direction
        return point


def fit(calibration: Calibration, points: Vector, pixels: Vector) -> BoardPose | None:
    """Fit a pose to corners.

    Args:
        calibration: the camera.
        points: corners on the board, n x 3 [m], n >= 4.
        pixels: their pixels in the picture, n x 2 [px].

    Returns:
        The pose; None if no pose with all points ahead of the camera is found.
    """
    rays = camera_model.rays(calibration, pixels)
    if not np.isfinite(rays).all():
        return None
    flat = np.ascontiguousarray(rays[:, :2])
    ok, turn, shift = cv2.solvePnP(points, flat, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
    if not ok:
        return None
    rotation: Vector = np.asarray(cv2.Rodrigues(turn)[0], np.float64)
    translation: Vector = np.asarray(shift, np.float64).ravel()
    for last in [False] * STEPS + [True]:
        turned = points @ rotation.T
        seen = turned + translation
        if not (seen[:, 2] > 1e-4).all():
            return None
        misfit = pixels - camera_model.project_points(calibration, seen)
        slope = _chain(calibration, turned, seen).reshape(-1, 6)
        information = slope.T @ slope
        if last:
            break
        try:
            step = np.linalg.solve(information, slope.T @ misfit.ravel())
        except np.linalg.LinAlgError:
            return None
        rotation = np.asarray(cv2.Rodrigues(step[:3])[0] @ rotation, np.float64)
        translation = translation + step[3:]
    return BoardPose(rotation, translation, misfit, information)


def _chain(calibration: Calibration, turned: Vector, seen: Vector) -> Vector:
    """Return the derivative of pixels by small rotations and translation, n x 2 x 6."""
    slope = camera_model.jacobian(calibration, seen)
    # A small rotation w moves a point p by w x p: pixel change = slope . (w x p) = w . (p x slope)
    return np.concatenate([np.cross(turned[:, None], slope), slope], axis=2)
