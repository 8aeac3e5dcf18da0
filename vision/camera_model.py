"""Camera models: from points to pixels and back, for a pinhole and for an equidistant fisheye.

In OpenCV axes (x right, y down, z ahead) a pinhole sees a point at u = cx + f x/z, v = cy + f y/z;
a fisheye sees it in the same direction off the centre, at r = f theta with tan(theta) =
hypot(x, y)/z. The centre of the first pixel is (0, 0), so the middle of a picture W pixels wide
is at (W-1)/2. Distortion follows OpenCV.
"""

from __future__ import annotations

from math import atan, hypot, nan, radians, tan

import cv2
import numpy as np
from numpy.typing import NDArray

from endolock.hw.api import Calibration, Vector

CUT = 0.30
"""Legs of the triangles that an octagonal mask cuts off at the corners, in picture heights.
Assumed."""
UNDISTORT = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-4
"""When undistorting a pixel of a pinhole ends: steps, and what is left [px]. With OpenCV's default
of five steps a pixel at 45 deg is off by 3 px where k1 = 0.1 and k2 = 0.2."""


def from_fovy(width: int, height: int, fovy_deg: float) -> Calibration:
    """Return the calibration of an ideal pinhole camera.

    Args:
        width: picture width [px].
        height: picture height [px].
        fovy_deg: full vertical field of view [deg]; f = height / (2 tan(fovy/2)).
    """
    return Calibration(
        width=width,
        height=height,
        focal_px=height / 2 / tan(radians(fovy_deg) / 2),
        centre_px=((width - 1) / 2, (height - 1) / 2),
    )


def project(calibration: Calibration, point_in_camera: Vector) -> tuple[float, float]:
    """Return the pixel at which a point is seen, also outside the picture.

    Args:
        calibration: the camera.
        point_in_camera: (x, y, z) in camera axes [m].

    Returns:
        (u, v) [px]; NaN for a point that is not ahead of the camera.
    """
    x, y, z = (float(c) for c in point_in_camera)
    if z <= 0:
        return nan, nan
    if calibration.distortion:
        u, v = project_points(calibration, np.array([[x, y, z]]))[0].tolist()
        return u, v
    (cx, cy), f = calibration.centre_px, calibration.focal_px
    if calibration.projection == "equidistant" and (off := hypot(x, y) / z):
        z /= atan(off) / off
    return cx + f * x / z, cy + f * calibration.aspect * y / z


def project_points(calibration: Calibration, points: Vector) -> Vector:
    """Return the pixels at which points ahead of the camera are seen.

    Args:
        calibration: the camera.
        points: n x 3 in camera axes [m], all with z > 0.

    Returns:
        n x 2 [px].
    """
    flat = points[:, :2] / points[:, 2:]
    if calibration.distortion:
        call = cv2.fisheye.projectPoints if _fisheye(calibration) else cv2.projectPoints
        solid = np.column_stack([flat, np.ones(len(flat))])[:, None]
        none, factors = np.zeros(3), np.array(calibration.distortion)
        seen = call(solid, none, none, calibration.matrix, factors)[0]
        return np.asarray(seen, np.float64).reshape(-1, 2)
    if _fisheye(calibration):
        off = np.maximum(np.hypot(flat[:, 0], flat[:, 1]), 1e-12)
        flat = flat * (np.arctan(off) / off)[:, None]
    focal = calibration.focal_px * np.array([1.0, calibration.aspect])
    pixels: Vector = calibration.centre_px + focal * flat
    return pixels


def jacobian(calibration: Calibration, points: Vector) -> Vector:
    """Return the derivative of the pixel by the point, n x 2 x 3 [px/m], from central differences.

    Args:
        calibration: the camera.
        points: n x 3 in camera axes [m], all with z > 0.
    """
    step = 1e-5 * points[:, 2:]  # errors of rounding and curvature: 1e-10 of the derivative each
    moves = [sign * step * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
    seen = project_points(calibration, np.concatenate([points + move for move in moves]))
    seen = seen.reshape(3, 2, len(points), 2)
    slope: Vector = (seen[:, 0] - seen[:, 1]) / (2 * step)
    return slope.transpose(1, 2, 0)


def rays(calibration: Calibration, pixels: Vector) -> Vector:
    """Return the points at unit depth that are seen at pixels, the inverse of `project_points`.

    Args:
        calibration: the camera.
        pixels: n x 2 [px].

    Returns:
        n x 3, each (x/z, y/z, 1); NaN for rays of a fisheye at 90 deg or more from the axis.
    """
    pixels = np.asarray(pixels, np.float64).reshape(-1, 2)
    if calibration.distortion:
        matrix, factors = calibration.matrix, np.array(calibration.distortion)
        if _fisheye(calibration):
            found = cv2.fisheye.undistortPoints(pixels[:, None], matrix, factors)
            off = np.hypot(*((pixels - calibration.centre_px) / np.diag(matrix)[:2]).T)
            ahead = off < np.pi / 2 - 1e-9  # OpenCV takes what is farther out to be there
        else:
            found = cv2.undistortPoints(pixels[:, None], matrix, factors, criteria=UNDISTORT)
            ahead = np.ones(len(pixels), bool)
        flat = np.where(ahead[:, None], np.asarray(found, np.float64).reshape(-1, 2), nan)
    else:
        focal = calibration.focal_px * np.array([1.0, calibration.aspect])
        flat = (pixels - calibration.centre_px) / focal
        if _fisheye(calibration):
            theta = np.maximum(np.hypot(flat[:, 0], flat[:, 1]), 1e-12)
            ahead = np.where(theta < np.pi / 2 - 1e-9, theta, nan)
            flat = flat * (np.tan(ahead) / theta)[:, None]
    return np.column_stack([flat, np.ones(len(flat))])


def ray(calibration: Calibration, pixel: tuple[float, float]) -> Vector:
    """Return the point (x/z, y/z, 1) that is seen at a pixel; see `rays`."""
    first: Vector = rays(calibration, np.array([pixel]))[0]
    return first


def in_picture(calibration: Calibration, pixel: tuple[float, float]) -> bool:
    """Return whether a pixel position is within the picture and its mask; False for NaN.

    An octagon lacks the corners, see `CUT`; a circle is as wide as the picture, around its middle.
    """
    u, v = pixel
    width, height = calibration.width, calibration.height
    if not (-0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5):
        return False
    right, down = abs(u - (width - 1) / 2), abs(v - (height - 1) / 2)
    if calibration.mask == "octagon":
        return right + down < (width + height) / 2 - CUT * height
    return calibration.mask == "none" or hypot(right, down) < width / 2


def visible(calibration: Calibration) -> NDArray[np.bool_]:
    """Return which pixels are within the mask, height x width; see `in_picture`."""
    width, height = calibration.width, calibration.height
    right = np.abs(np.arange(width) - (width - 1) / 2)
    down = np.abs(np.arange(height) - (height - 1) / 2)[:, None]
    if calibration.mask == "octagon":
        return np.asarray(right + down < (width + height) / 2 - CUT * height)
    if calibration.mask == "circle":
        return np.asarray(np.hypot(right, down) < width / 2)
    return np.ones((height, width), bool)


def offset(calibration: Calibration, pixel: tuple[float, float]) -> tuple[float, float]:
    """Return the offset of a pixel from the image centre, (right, down) [px]."""
    cx, cy = calibration.centre_px
    return pixel[0] - cx, pixel[1] - cy


def off_axis_angle(calibration: Calibration, pixel: tuple[float, float]) -> float:
    """Return the angle between the optical axis and the ray through a pixel [rad]."""
    right, down = offset(calibration, pixel)
    if calibration.distortion:
        x, y, _ = ray(calibration, pixel).tolist()
        return atan(hypot(x, y))
    r = hypot(right, down / calibration.aspect) / calibration.focal_px
    return r if _fisheye(calibration) else atan(r)


def _fisheye(calibration: Calibration) -> bool:
    return calibration.projection == "equidistant"
