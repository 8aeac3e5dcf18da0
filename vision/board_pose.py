"""Pose of a board from corners found in a picture: SQPNP, then least squares in pixels.

With the corners' noise even in the picture, the pose that makes the sum of squared pixel misfits
smallest is the most likely one, also where a fisheye bends the picture; SQPNP gives the start.

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
"""Gauss-Newton steps; the first comes within 1e-3 px of the end. Source: measured."""


class BoardPose(NamedTuple):
    """A fitted pose and how well it fits."""

    rotation: Vector
    """3x3, camera_from_board."""
    translation: Vector
    """Of the board's centre in camera axes [m]."""
    misfit: Vector
    """Pixel found less pixel expected, n x 2 [px]."""
    information: Vector
    """J^T J, 6x6, of small rotations about the camera's axes and translations."""

    def place(self, calibration: Calibration, point: Vector) -> tuple[Vector, Vector, Vector]:
        """Say where a point of the board is and is seen.

        Args:
            calibration: the camera.
            point: (x, y, z) on the board [m].

        Returns:
            The point in camera axes [m], its pixel, and the pixel's derivative, 2x6, with respect
            to rotation and translation.
        """
        seen = self.rotation @ point + self.translation
        pixel = np.array(camera_model.project(calibration, seen))
        return seen, pixel, _chain(calibration, (seen - self.translation)[None], seen[None])[0]

    def under(self, ray: Vector) -> Vector:
        """Point of the board's plane, in board axes [m], that a ray (x/z, y/z, 1) meets."""
        start = -self.rotation.T @ self.translation
        way = self.rotation.T @ ray
        point: Vector = start - start[2] / way[2] * way
        return point


def fit(calibration: Calibration, points: Vector, pixels: Vector) -> BoardPose | None:
    """Fit a pose.

    Args:
        calibration: the camera.
        points: n x 3 on the board [m], n >= 4.
        pixels: n x 2, where they were found [px].

    Returns:
        The pose; None where there is none with all points ahead of the camera.
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
    """Derivative of pixels with respect to small rotations and to translation, n x 2 x 6."""
    slope = camera_model.jacobian(calibration, seen)
    # A small rotation w moves a point p by w x p: pixel change = slope . (w x p) = w . (p x slope)
    return np.concatenate([np.cross(turned[:, None], slope), slope], axis=2)
