"""Where a lost target is looked for: where it was last, then around it, then where it usually was.

The tip returns to the last place and waits there, since most targets are hidden for a moment or
come back. Then it winds outwards by one turn and inwards by another, at constant speed,

    place = last + r (cos(phi_0 + phi), sin(phi_0 + phi)),
    r = R phi / (2 pi) up to 2 pi, then R (2 - phi / (2 pi)) up to 4 pi,

and does the same at the mean of the places where the target was, where it stays for good. R is a
fraction of the camera's field of view, so the middle of a spiral remains in the picture all the
time: a target that comes back there is never missed.
"""

from __future__ import annotations

from math import asinh, atan2, cos, hypot, pi, sin

from endolock.control.transmission.kinematics import LARGEST_BEND_RAD, Pair
from endolock.hw.api import Calibration
from endolock.vision import camera_model

WAIT_S = 8.0
"""Time at the last place before the spiral [s]. Assumed: a target that moves to and fro passes
there again within a slow period, and is seen at once where the camera has stayed."""
SPEED_RAD_S = 0.3
"""Speed of the spiral [rad/s]. Assumed: at f = 262 px and an exposure of 20 ms the blur is 1.6
px."""
VIEW_SHARE = 0.35
"""Largest distance from the last place, of half the field of view [1]. Assumed: leaves 65 % of it
between the last place and the edge of the picture."""
HANDLE_SPEED_RAD_S = 1.0
"""Largest speed of the handles meanwhile [rad/s]. Assumed: a loop 0.6 rad wide, in which
the tip rests, is crossed in 0.6 s."""


def half_view_rad(calibration: Calibration) -> float:
    """Return the smallest angle between the optical axis and the edge of the picture [rad]."""
    (u, v), width, height = calibration.centre_px, calibration.width, calibration.height
    edges = ((0.0, v), (width - 1.0, v), (u, 0.0), (u, height - 1.0))
    return min(camera_model.off_axis_angle(calibration, edge) for edge in edges)


def place(last: Pair, usual: Pair, heading: Pair, lost_s: float, half_view: float) -> Pair:
    """Return the bend at which to look for the target.

    Args:
        last: bend that aims at where the target was last seen [rad].
        usual: bend that aims at the mean of its places [rad].
        heading: direction in which the spirals begin, of any length; (0, 0) for any.
        lost_s: time since the target was lost [s].
        half_view: from `half_view_rad` [rad].

    Returns:
        The bend [rad]; its norm is at most `LARGEST_BEND_RAD`.
    """
    radius = VIEW_SHARE * half_view
    whole = _length(2 * pi, radius)
    first = WAIT_S + 2 * whole / SPEED_RAD_S
    middle, since_s = (last, lost_s) if lost_s < first else (usual, lost_s - first)
    length = SPEED_RAD_S * (since_s - WAIT_S)
    if not 0 < length < 2 * whole:
        return _within_reach(middle)
    angle = _angle(min(length, 2 * whole - length), radius)
    r = radius * angle / (2 * pi)
    turned = atan2(heading[1], heading[0]) + (angle if length < whole else 4 * pi - angle)
    return _within_reach((middle[0] + r * cos(turned), middle[1] + r * sin(turned)))


def duration_s(half_view: float) -> float:
    """Return the time from losing the target to the end of the search [s].

    Args:
        half_view: from `half_view_rad` [rad].
    """
    return 2 * (WAIT_S + 2 * _length(2 * pi, VIEW_SHARE * half_view) / SPEED_RAD_S)


def _length(angle: float, radius: float) -> float:
    """Length of the spiral up to an angle [rad]: the integral of radius/2 pi sqrt(1 + angle^2)."""
    return radius / (4 * pi) * (angle * hypot(1.0, angle) + asinh(angle))


def _angle(length: float, radius: float) -> float:
    """Angle at which the spiral has a length, by Newton's method from above [rad]."""
    angle = 2 * pi
    for _ in range(8):  # convex and from above: it converges, to rounding in 6
        slope = radius / (2 * pi) * hypot(1.0, angle)
        angle -= (_length(angle, radius) - length) / slope
    return max(angle, 0.0)


def _within_reach(bend: Pair) -> Pair:
    share = min(1.0, LARGEST_BEND_RAD / max(hypot(*bend), 1e-9))
    return share * bend[0], share * bend[1]
