"""Frames, the target and the tip in them, and how the tip turned between two of them.

The background shows the camera's rotation w between two frames, in axes of the first. The bend, as
a rotation vector b, then changes by

    w = J(b) db,     J(b) = 1 - (1 - cos t)/t^2 K + (t - sin t)/t^3 K^2,

with t the size of b and K the cross product with it; b has no part along the axis of the camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, hypot, sin
from typing import NamedTuple

import numpy as np

from endolock.control.transmission.kinematics import LARGEST_BEND_RAD
from endolock.hw.api import Vector

NEWEST = 10
"""Number of frames among which the start of a turn is looked for [1]."""


class SeenFrame(NamedTuple):
    """One frame in which the target was found."""

    t: float
    """Believed time of exposure [s]."""
    bend: Vector
    """Bend of the tip at that time, in axes of the video, 2 [rad]."""
    offset: Vector
    """Offset of the target from the optical axis, in bends, 2 [rad]."""
    columns: Vector
    """Columns at that time, 2 x `COLUMNS` [rad]."""
    turned: bool
    """Whether the bend was measured by the background, from the frame before."""


class TipSeen(NamedTuple):
    """The tip at the exposure of a frame, whether or not it shows the target."""

    t: float
    """Believed time of exposure [s]."""
    bend: Vector
    """Its bend, in axes of the video, 2 [rad]."""
    model: Vector
    """Its bend by the model in use, 2 [rad]."""
    columns: Vector
    """Columns at that time, 2 x `COLUMNS` [rad]."""
    turned: bool
    """Whether the bend was measured by the background, from the frame before."""


def tip_of(tips: Sequence[TipSeen], t: float) -> TipSeen | None:
    """Return the tip in the frame believed to be exposed at a time [s], if there is one."""
    for tip in reversed(tips):
        if abs(tip.t - t) < 1e-6:
            return tip
    return None


def frame_before(frames: list[SeenFrame], t: float) -> SeenFrame | None:
    """Return the newest frame that is not later than a time [s]."""
    for frame in reversed(frames):
        if frame.t <= t:
            return frame
    return None


def bend_change(turn: Vector, bend: Vector) -> Vector:
    """Change of the bend, 2 [rad].

    Args:
        turn: rotation of the camera since a frame, in its axes then, 3 [rad].
        bend: bend in that frame, 2 [rad].
    """
    (a, d, _), (b, e, _), (c, f, _) = right_jacobian(bend).tolist()
    x, y, z = turn.tolist()
    # least squares: the columns are far from parallel
    first, mixed, second = a * a + b * b + c * c, a * d + b * e + c * f, d * d + e * e + f * f
    one, two = a * x + b * y + c * z, d * x + e * y + f * z
    volume = first * second - mixed * mixed
    return np.array([(second * one - mixed * two) / volume, (first * two - mixed * one) / volume])


def right_jacobian(bend: Vector) -> Vector:
    """Derivative of the camera's rotation, in its axes, by the rotation vector of the tip, 3 x 3.

    Args:
        bend: first two parts of that vector, 2 [rad]; the third is 0.
    """
    up_down, left_right = float(bend[0]), float(bend[1])
    t = min(hypot(up_down, left_right), LARGEST_BEND_RAD)
    half, cubic = 0.5, 1 / 6
    if t >= 1e-4:
        half, cubic = (1 - cos(t)) / t**2, (t - sin(t)) / t**3
    mixed, size = cubic * up_down * left_right, up_down**2 + left_right**2
    return np.array(
        [
            [1 - cubic * left_right**2, mixed, -half * left_right],
            [mixed, 1 - cubic * up_down**2, half * up_down],
            [half * left_right, -half * up_down, 1 - cubic * size],
        ]
    )
