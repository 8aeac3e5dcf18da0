"""The pinhole camera: from points to pixels and back.

u = cx + f x/z, v = cy + f y/z in OpenCV axes (x right, y down, z ahead); the centre of the first
pixel is (0, 0), so the middle of a W pixel wide picture lies at (W-1)/2.
"""

from __future__ import annotations

from math import atan, hypot, nan, radians, tan

from endolock.hw.api import Calibration, Vector


def from_fovy(width: int, height: int, fovy_deg: float) -> Calibration:
    """Return the calibration of an ideal camera.

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
    """Pixel at which a point is seen, also outside the picture.

    Args:
        calibration: the camera.
        point_in_camera: (x, y, z) in camera axes [m].

    Returns:
        (u, v) [px]; NaN for a point that is not ahead of the camera.
    """
    x, y, z = (float(c) for c in point_in_camera)
    if z <= 0:
        return nan, nan
    (cx, cy), f = calibration.centre_px, calibration.focal_px
    return cx + f * x / z, cy + f * y / z


def in_picture(calibration: Calibration, pixel: tuple[float, float]) -> bool:
    """Whether a pixel position lies within the picture; NaN does not."""
    u, v = pixel
    return -0.5 <= u < calibration.width - 0.5 and -0.5 <= v < calibration.height - 0.5


def offset(calibration: Calibration, pixel: tuple[float, float]) -> tuple[float, float]:
    """Offset of a pixel from the image centre, (right, down) [px]."""
    cx, cy = calibration.centre_px
    return pixel[0] - cx, pixel[1] - cy


def off_axis_angle(calibration: Calibration, pixel: tuple[float, float]) -> float:
    """Angle between the optical axis and the ray through a pixel [rad]."""
    return atan(hypot(*offset(calibration, pixel)) / calibration.focal_px)
