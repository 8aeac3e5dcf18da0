"""Constant-curvature kinematics of a bending section with a rigid tip.

A bend (up_down, left_right) is the rotation vector of the tip in base axes (x right, y down,
z distal); with t its size, the section is an arc of length L and curvature t/L in the plane of
d = (left_right, -up_down)/t, and the tip looks along d sin t + z cos t. The base frame's origin is
the camera at rest, L + l ahead of the section's base.

Reference:
    R. J. Webster III and B. A. Jones, Int. J. Robotics Research 29(13), 2010.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, pi, sin

import numpy as np

from endolock.hw.api import Calibration, ConfigError, Vector
from endolock.hw.rotation import matrix_about_z
from endolock.vision import camera_model

Pair = tuple[float, float]
"""One number for each axis, (up_down, left_right)."""
LARGEST_BEND_RAD = 2.6
"""Targets that need more are aimed at with this bend [rad]; 150 deg. Assumed."""
CLOSE_RAD = 1e-14
"""Last step of the search for a bend [rad]."""


@dataclass(frozen=True, kw_only=True)
class SectionGeometry:
    """Lengths of the section, as measured with a ruler."""

    bending_length_m: float = 0.075
    """Along the backbone [m], > 0. Assumed, as the default instrument's."""
    rigid_tip_m: float = 0.015
    """From the end of the bending part to the camera [m], >= 0. Assumed."""
    misalignment_rad: float = 0.0
    """Rotation of the picture relative to the wires, about the optical axis [rad]; positive turns
    the camera's right towards its down. Assumed: none."""

    def __post_init__(self) -> None:
        lengths_fit = 0 < self.bending_length_m <= 1 and 0 <= self.rigid_tip_m <= 1
        if not (lengths_fit and abs(self.misalignment_rad) <= pi):
            raise ConfigError(
                f"section of {self.bending_length_m:g} m with a tip of {self.rigid_tip_m:g} m",
                "use a length above 0 and a tip of 0 or more, in metres, and a misalignment_rad of "
                "-pi to pi",
            )


def forward(geometry: SectionGeometry, bend: Pair) -> tuple[Vector, Vector]:
    """Pose of the tip camera.

    Args:
        geometry: lengths of the section.
        bend: (up_down, left_right) [rad].

    Returns:
        Its position [m] and orientation (3x3, base_from_camera) in base axes.
    """
    up_down, left_right = bend
    t = hypot(up_down, left_right)
    length, tip = geometry.bending_length_m, geometry.rigid_tip_m
    sinc = sin(t) / t if t > 1e-8 else 1.0
    half = 2 * (sin(t / 2) / t) ** 2 if t > 1e-8 else 0.5  # (1 - cos t)/t^2, without cancellation
    # factors of d t, so that nothing is divided by a vanishing bend
    sideways = length * half + tip * sinc
    ahead = length * sinc + tip * cos(t) - length - tip
    position = np.array([sideways * left_right, -sideways * up_down, ahead])
    # Rodrigues' formula: R = 1 + sinc K + half K^2, K the cross product with the rotation vector
    cross = _cross(up_down, left_right)
    rotation = _SAME + sinc * cross + half * (cross @ cross)
    if turn := geometry.misalignment_rad:
        rotation = rotation @ matrix_about_z(turn)
    return position, rotation


def image_jacobian(
    geometry: SectionGeometry, calibration: Calibration, bend: Pair, target_m: Vector
) -> Vector:
    """Derivative of the target's pixel with respect to the bend, 2x2 [px/rad].

    A point p = R' (X - x) in camera axes moves by dp = -R' (dx + w x (X - x)), where x is the
    camera's position and w = J dbend its rotation, J the left Jacobian of the rotation vector.

    Args:
        geometry: lengths of the section.
        calibration: the camera.
        bend: (up_down, left_right) [rad].
        target_m: position in base axes [m], ahead of the camera.
    """
    up_down, left_right = bend
    t = hypot(up_down, left_right)
    length, tip = geometry.bending_length_m, geometry.rigid_tip_m
    position, rotation = forward(geometry, bend)
    if t > 1e-4:
        sinc, half = sin(t) / t, 2 * (sin(t / 2) / t) ** 2
        dsinc, dhalf, cubic = (cos(t) - sinc) / t**2, (sinc - 2 * half) / t**2, (1 - sinc) / t**2
    else:  # to t^2
        sinc, half, dsinc, dhalf, cubic = 1.0, 0.5, -1 / 3, -1 / 12, 1 / 6
    # With s the sideways factor of `forward`: d(s b)/db_i = s e_i + b (ds/dt / t) b_i.
    sideways, slope = length * half + tip * sinc, length * dhalf + tip * dsinc
    ahead = length * dsinc - tip * sinc
    turned = np.array([left_right, -up_down])
    moved = np.array([[0.0, sideways], [-sideways, 0.0], [ahead * up_down, ahead * left_right]])
    moved[:2] += slope * np.outer(turned, bend)
    cross = _cross(up_down, left_right)
    turns = (np.eye(3) + half * cross + cubic * (cross @ cross))[:, :2]
    apart = target_m - position
    dp = -rotation.T @ (moved + np.cross(turns.T, apart).T)
    point = (rotation.T @ apart)[None]
    jacobian: Vector = camera_model.jacobian(calibration, point)[0] @ dp
    return jacobian


_SAME = np.eye(3)


def _cross(up_down: float, left_right: float) -> Vector:
    """Matrix of the cross product with a rotation vector (up_down, left_right, 0)."""
    return np.array([[0, 0, left_right], [0, 0, -up_down], [-left_right, up_down, 0]])


def aim(geometry: SectionGeometry, target_m: Vector) -> Pair:
    """Bend that points the optical axis at a target.

    With r the target's distance from the section's axis at rest and z its distance ahead of the
    section's base, r cos t - z sin t + L (1 - cos t)/t = 0; the rigid tip cancels out.

    Args:
        geometry: lengths of the section.
        target_m: position in base axes [m].

    Returns:
        (up_down, left_right) [rad], of norm `LARGEST_BEND_RAD` at most.
    """
    x, y = float(target_m[0]), float(target_m[1])
    z = float(target_m[2]) + geometry.bending_length_m + geometry.rigid_tip_m
    r, length = hypot(x, y), geometry.bending_length_m
    if r < 1e-12:
        return 0.0, 0.0
    low, high = 0.0, LARGEST_BEND_RAD  # the left side is r > 0 at 0
    t = high / 4
    for _ in range(100):  # Newton steps within a bracket
        c, s, half = cos(t), sin(t), 2 * length * sin(t / 2) ** 2 / t
        left = r * c - z * s + half
        if left > 0:
            low = t
        else:
            high = t
        slope = -r * s - z * c + (length * s - half) / t
        before, t = t, t - left / slope if slope < 0 else high
        if not low < t < high:
            t = (low + high) / 2
        if abs(t - before) < CLOSE_RAD:
            break
    return -t * y / r, t * x / r
