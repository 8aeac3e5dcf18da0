"""Whether the geometry of a camera can be that of a real one.

A picture centre given as a fraction of the picture, or a focal length in millimetres, would turn a
pixel into a command of many turns. Distortion must be one-to-one within the picture: going outward
from the axis, the pixel must move outward too, until it has left the picture.
"""

from __future__ import annotations

from datetime import date
from math import pi, radians

import cv2
import numpy as np

from endolock.hw.api import Calibration, ConfigError, Vector

AGAIN = "make one with endolock calibrate"
SIDES_PX = 16, 16384
"""Least and largest side of a picture [px]. Assumed."""
FOCAL = {"pinhole": (0.1, 20.0), "equidistant": (0.2, 20.0)}
"""Least and largest focal length relative to the width [1]: 157 deg for a pinhole and 286 deg for a
fisheye down to 3 deg from left to right. Assumed."""
CENTRE = 0.1, 0.9
"""Where the principal point may be, relative to width and height [1]. Assumed."""
ASPECT = 0.5, 2.0
"""Least and largest aspect of a pixel [1]: 0.5 for every second row. Assumed."""
COEFFICIENTS = {"pinhole": (0, 4, 5, 8, 12, 14), "equidistant": (0, 4)}
"""Numbers of distortion coefficients that OpenCV has models for."""
LARGEST_RMS_PX = 10.0
"""Largest residual of a calibration [px]. Assumed."""
LARGEST_COEFFICIENT = 1e4
"""Largest magnitude of a distortion coefficient [1]: those of the rational model reach hundreds.
Assumed."""
DISTORTED = 3.0
"""Distortion may move a pixel outward to this many times its distance from the axis, or inward to
the inverse [1]. Assumed: a stereographic lens taken for a pinhole at 70 deg moves it to half."""
BACK_PX = 0.5
"""Undistorting a pixel and distorting it again may miss it by this much [px]. Assumed."""
UNDISTORT = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-4
"""When undistorting a pixel ends: steps, and what is left [px]. As in `vision.camera_model`."""
_DIRECTIONS, _STEPS, _WIDEST_DEG = 48, 400, 86.0


def check(camera: Calibration) -> None:
    """Check that a camera is plausible.

    Raises:
        ConfigError: it is not; says which value, its range and what to do.
    """
    for side in ("width", "height"):
        _within(side, getattr(camera, side), *SIDES_PX, "px")
    low, high = (share * camera.width for share in FOCAL[camera.projection])
    step = f"give pixels, for {camera.projection} pictures {camera.width} px wide"
    _within("focal_px", camera.focal_px, low, high, "px", step)
    for axis, size in enumerate((camera.width, camera.height)):
        low, high = (share * size for share in CENTRE)
        step = f"give pixels of a picture of {camera.width}x{camera.height} px"
        _within(f"centre_px.{axis}", camera.centre_px[axis], low, high, "px", step)
    _within("aspect", camera.aspect, *ASPECT, "")
    _within("rms_px", camera.rms_px, 0.0, LARGEST_RMS_PX, "px")
    if camera.date:
        try:
            date.fromisoformat(camera.date)
        except ValueError:
            raise ConfigError(f"date: got {camera.date!r}, wanted YYYY-MM-DD", AGAIN) from None
    _distortion(camera)


def _within(
    key: str, value: float, low: float, high: float, unit: str, next_step: str = AGAIN
) -> None:
    if not low <= value <= high:  # NaN is nowhere
        unit = f" {unit}" if unit else ""
        raise ConfigError(
            f"{key}: got {value:g}{unit}, wanted {low:g} to {high:g}{unit}", next_step
        )


def _distortion(camera: Calibration) -> None:
    allowed = COEFFICIENTS[camera.projection]
    if len(camera.distortion) not in allowed:
        raise ConfigError(
            f"distortion: got {len(camera.distortion)} coefficients, wanted "
            f"{', '.join(str(n) for n in allowed)} for {camera.projection}",
            AGAIN,
        )
    for n, factor in enumerate(camera.distortion):
        _within(f"distortion.{n}", factor, -LARGEST_COEFFICIENT, LARGEST_COEFFICIENT, "")
    if any(camera.distortion):
        _one_to_one(camera)


def _one_to_one(camera: Calibration) -> None:
    """Check that distortion does not fold within the picture, and can be undone there."""
    angles = np.linspace(0.0, radians(_WIDEST_DEG), _STEPS)[1:]
    turns = np.linspace(0.0, 2 * pi, _DIRECTIONS, endpoint=False)
    outward = np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    rays = np.tan(angles)[None, :, None] * outward[:, None]
    pixels = _project(camera, rays.reshape(-1, 2)).reshape(_DIRECTIONS, -1, 2)
    with np.errstate(all="ignore"):
        far = np.hypot(*np.moveaxis((pixels - camera.centre_px) / (1.0, camera.aspect), -1, 0))
        grows = np.diff(far, axis=1, prepend=0.0) > 0
    size = np.array([camera.width, camera.height])
    outside = ~((pixels >= -0.5) & (pixels <= size - 0.5)).all(axis=-1)
    gone = np.logical_or.accumulate(outside & np.isfinite(far), axis=1)
    folded = ~(grows | gone)
    if folded.any() or (camera.projection == "pinhole" and not gone[:, -1].all()):
        at = folded if folded.any() else ~gone
        angle = np.degrees(angles[np.nonzero(at.any(axis=0))[0][0 if folded.any() else -1]])
        raise ConfigError(
            f"distortion: the picture folds within itself {angle:.0f} deg off the axis", AGAIN
        )
    ideal = camera.focal_px * (np.tan(angles) if camera.projection == "pinhole" else angles)
    moved = np.where(gone, 1.0, far / ideal)
    worst = float(moved.flat[np.abs(np.log(moved)).argmax()])
    _within("distortion: it moves a pixel outward", worst, 1 / DISTORTED, DISTORTED, "times")
    if camera.projection == "pinhole":
        _invertible(camera)


def _invertible(camera: Calibration) -> None:
    """Check that the pixels of the picture can be undistorted."""
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 13), np.linspace(0, camera.height - 1, 9))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    factors = np.array(camera.distortion)
    flat = np.asarray(
        cv2.undistortPoints(pixels[:, None], camera.matrix, factors, criteria=UNDISTORT)
    )
    missed = _project(camera, flat.reshape(-1, 2).astype(np.float64)) - pixels
    worst = float(np.max(np.hypot(missed[:, 0], missed[:, 1])))
    if not worst <= BACK_PX:
        raise ConfigError(
            f"distortion: undone and done again it misses a pixel by {worst:.3g} px, "
            f"{BACK_PX:g} px allowed",
            AGAIN,
        )


def _project(camera: Calibration, flat: Vector) -> Vector:
    """Return the pixels of points at unit depth, n x 2."""
    call = cv2.fisheye.projectPoints if camera.projection == "equidistant" else cv2.projectPoints
    solid = np.column_stack([flat, np.ones(len(flat))])[:, None]
    none = np.zeros(3)
    seen = call(solid, none, none, camera.matrix, np.array(camera.distortion))[0]
    return np.asarray(seen, np.float64).reshape(-1, 2)
