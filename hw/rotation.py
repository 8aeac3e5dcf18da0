"""Rotations as unit quaternions, scalar first, as rotation vectors and as 3x3 matrices.

A quaternion (w, x, y, z) = (cos(angle/2), sin(angle/2) axis), its negative and the rotation vector
angle * axis mean the same rotation, p' = R p with the matrix R.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, copysign, cos, hypot, sin, sqrt

import numpy as np
from numpy.typing import NDArray

Quaternion = tuple[float, float, float, float]
Matrix = NDArray[np.float64]


def about(axis: Sequence[float], angle_rad: float) -> Quaternion:
    """Return the quaternion of a rotation about a unit axis (x, y, z)."""
    x, y, z = axis
    s = sin(angle_rad / 2)
    return cos(angle_rad / 2), s * x, s * y, s * z


def from_vector(vector: Sequence[float]) -> Quaternion:
    """Return the quaternion of a rotation vector [rad]."""
    x, y, z = vector
    angle_rad = hypot(x, y, z)
    if angle_rad == 0.0:
        return 1.0, 0.0, 0.0, 0.0
    return about((x / angle_rad, y / angle_rad, z / angle_rad), angle_rad)


def from_matrix(matrix: Matrix) -> Quaternion:
    """Return the quaternion of a rotation matrix, 3x3; its largest component is positive."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix.tolist()
    if xx + yy + zz > 0:
        w = 0.5 * sqrt(1 + xx + yy + zz)
        return _normalised(w, 0.25 * (zy - yz) / w, 0.25 * (xz - zx) / w, 0.25 * (yx - xy) / w)
    if xx > yy and xx > zz:
        x = 0.5 * sqrt(1 + xx - yy - zz)
        return _normalised(0.25 * (zy - yz) / x, x, 0.25 * (yx + xy) / x, 0.25 * (xz + zx) / x)
    if yy > zz:
        y = 0.5 * sqrt(1 - xx + yy - zz)
        return _normalised(0.25 * (xz - zx) / y, 0.25 * (yx + xy) / y, y, 0.25 * (zy + yz) / y)
    z = 0.5 * sqrt(1 - xx - yy + zz)
    return _normalised(0.25 * (yx - xy) / z, 0.25 * (xz + zx) / z, 0.25 * (zy + yz) / z, z)


def product(first: Quaternion, second: Quaternion) -> Quaternion:
    """Return the quaternion of the matrix product R_first R_second."""
    (a, b, c, d), (w, x, y, z) = first, second
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def to_matrix(quaternion: Quaternion) -> Matrix:
    """Return the rotation matrix, 3x3."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def to_vector(quaternion: Quaternion) -> tuple[float, float, float]:
    """Return the rotation vector [rad], at most pi long."""
    w, x, y, z = quaternion
    size = hypot(x, y, z)
    if size == 0.0:
        return 0.0, 0.0, 0.0
    scale = 2 * atan2(copysign(size, w), abs(w)) / size
    return scale * x, scale * y, scale * z


def matrix_about_z(angle_rad: float) -> Matrix:
    """Return the matrix, 3x3, of a rotation about the z axis: x turns towards y."""
    c, s = cos(angle_rad), sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _normalised(w: float, x: float, y: float, z: float) -> Quaternion:
    size = sqrt(w * w + x * x + y * y + z * z)
    if abs(size - 1.0) <= 1e-15:
        return w, x, y, z
    scale = 1 / size
    return scale * w, scale * x, scale * y, scale * z
