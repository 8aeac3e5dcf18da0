"""Calibrates a camera from pictures of a board.

Reference:
    Z. Zhang, IEEE PAMI 22(11), 2000; J. Kannala and S. Brandt, IEEE PAMI 28(8), 2006 (fisheye);
    both as implemented in OpenCV.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from math import degrees
from typing import Literal

import cv2
import numpy as np

from endolock.hw.api import BoardGeometry, Calibration, ConfigError, Vector
from endolock.vision import board_pose
from endolock.vision.detector import Marker

MIN_VIEWS = 10
MIN_CORNERS = 16
"""Fewest corners of a view: four markers."""
MAX_VIEWS = 60
"""Most views used; more take longer without better results."""
MIN_TILT_DEG = 25.0
"""Least angle that two views of the board must differ by [deg]: from a single direction, a longer
focal length looks like a larger distance. Source: within 17 deg it was 3 % too long."""
MAX_RMS_PX = 1.0
"""Largest residual of an acceptable calibration [px]. Assumed: seven times the noise of corners."""


def calibrate(
    views: Sequence[Sequence[Marker]],
    board: BoardGeometry,
    size: tuple[int, int],
    projection: Literal["pinhole", "equidistant"] = "pinhole",
) -> Calibration:
    """Estimate the geometry of a camera from markers of a board, seen from several directions.

    Args:
        views: the markers found in each picture.
        board: geometry of the board.
        size: width and height of the pictures [px].
        projection: projection of the lens.

    Raises:
        ConfigError: the views do not determine it.
    """
    corners = board.corners()
    useful = [view for view in views if 4 * len(view) >= MIN_CORNERS]
    if len(useful) < MIN_VIEWS:
        raise ConfigError(
            f"the board is seen with {MIN_CORNERS // 4} markers or more in {len(useful)} pictures, "
            f"{MIN_VIEWS} needed",
            "record a longer sequence, nearer, in better light",
        )
    count = min(len(useful), MAX_VIEWS)
    chosen = [useful[n] for n in np.linspace(0, len(useful) - 1, count).round().astype(int)]
    points = [np.concatenate([corners[i] for _, i in view]) for view in chosen]
    pixels = [np.concatenate([seen for seen, _ in view]) for view in chosen]
    rms, matrix, distortion = _solve(points, pixels, size, projection)
    found = Calibration(
        width=size[0],
        height=size[1],
        focal_px=float(matrix[0, 0]),
        centre_px=(float(matrix[0, 2]), float(matrix[1, 2])),
        aspect=float(matrix[1, 1] / matrix[0, 0]),
        projection=projection,
        distortion=tuple(float(c) for c in distortion),
        rms_px=rms,
        date=datetime.now(UTC).strftime("%Y-%m-%d"),
    )
    if not rms <= MAX_RMS_PX:
        raise ConfigError(
            f"calibration has a residual of {rms:.2f} px rms, {MAX_RMS_PX} allowed",
            f"check that it is a {projection} camera and that the board was printed at 100 %",
        )
    try:
        tilt = _spread(found, points, pixels)
    except cv2.error:  # no board pose fits this lens
        tilt = 0.0
    if tilt < MIN_TILT_DEG:
        raise ConfigError(
            f"the views of the board differ by {tilt:.0f} deg, {MIN_TILT_DEG:.0f} needed",
            "record it from more directions",
        )
    return found


def _solve(
    points: list[Vector], pixels: list[Vector], size: tuple[int, int], projection: str
) -> tuple[float, Vector, Vector]:
    """Return the rms residual [px], the camera matrix and the distortion."""
    try:
        if projection == "pinhole":
            flat = [p.astype(np.float32) for p in points]
            seen = [p.astype(np.float32) for p in pixels]
            rms, matrix, distortion, _, _ = cv2.calibrateCamera(
                flat, seen, size, np.eye(3), np.zeros(5)
            )
        else:
            solid = [p[None] for p in points]
            found = [p[None] for p in pixels]
            start = np.array([[size[0] / 2.1, 0, size[0] / 2], [0, size[0] / 2.1, size[1] / 2]])
            flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
            flags |= cv2.CALIB_USE_INTRINSIC_GUESS
            rms, matrix, distortion, _, _ = cv2.fisheye.calibrate(
                solid, found, size, np.vstack([start, [0, 0, 1]]), np.zeros(4), flags=flags
            )
    except cv2.error as error:
        said = " ".join(str(error).split()[:12])
        raise ConfigError(
            f"OpenCV could not calibrate a {projection} camera from these pictures ({said})",
            "record the board from more directions",
        ) from None
    return float(rms), np.asarray(matrix, np.float64), np.asarray(distortion, np.float64).ravel()


def _spread(found: Calibration, points: list[Vector], pixels: list[Vector]) -> float:
    """Return the largest angle between the normals of the board in two views [deg]."""
    poses = [board_pose.fit(found, *pair) for pair in zip(points, pixels, strict=True)]
    normals = np.array([pose.rotation[:, 2] for pose in poses if pose is not None])
    return degrees(float(np.arccos(np.clip((normals @ normals.T).min(), -1.0, 1.0))))
