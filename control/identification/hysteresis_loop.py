"""What a recorded hysteresis loop says: widths at given bends, and the deadband.

A branch is a stroke of the handle in one direction. The handle angle h(theta) at which it passes a
bend theta is taken by counting: with the bend rising, the branch's last handle angle less the
travel during which the bend was above theta. Noise on either side cancels, nothing is smoothed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from endolock.hw.api import Vector

MIDDLE_RAD = np.radians(10.0)
"""A deadband is looked for within +- this bend."""
WINDOW_RAD = np.radians(0.5)
"""Bend on either side of a deadband that counts as within it [rad]: ten times a tracker's noise."""
FOLLOWED_RAD = np.radians([8.0, 12.0])
"""Between these bends from where it turned, the bend follows the handle [rad]: before, part of the
cable still sticks."""
SMALLEST_RAD = 0.01
"""Smallest deadband that is told from noise and curvature [rad]."""
BESIDE_RAD = np.radians(4.0)
"""The slopes beside a deadband are taken over this bend [rad]."""


@dataclass(frozen=True)
class Branch:
    """A stroke of one handle in one direction.

    Args:
        handle: handle angles [rad], rising or falling throughout.
        bend: bends of the same axis at the same moments [rad].
    """

    handle: Vector
    bend: Vector

    def passes(self, bend_rad: float) -> float | None:
        """Handle angle at which the branch passes a bend [rad]; None if it does not."""
        low, high = sorted((float(self.bend[0]), float(self.bend[-1])))
        if not low < bend_rad < high:
            return None
        above = np.where(self.bend == bend_rad, 0.5, self.bend > bend_rad)
        travel = np.sum((above[1:] + above[:-1]) / 2 * np.diff(self.handle))
        # rising: the last part is above, and ends at the last angle; falling: the first part
        rising = self.bend[-1] > self.bend[0]
        return float(self.handle[-1] - travel if rising else self.handle[0] + travel)


def width(one: Branch, other: Branch, bend_rad: float) -> float | None:
    """Handle travel between two branches at a bend [rad]; None if one does not pass it."""
    first, second = one.passes(bend_rad), other.passes(bend_rad)
    return None if first is None or second is None else abs(first - second)


def lost_after_turn(branch: Branch) -> float | None:
    """Handle travel after the turn at the start of a branch before the bend follows [rad].

    The line through the two bends `FOLLOWED_RAD` from the start, carried back to the bend at the
    start, tells it; None where the bend does not go so far.
    """
    start = float(np.mean(branch.bend[:5]))
    near, far = (
        branch.passes(start + np.copysign(way, branch.bend[-1] - start)) for way in FOLLOWED_RAD
    )
    if near is None or far is None:
        return None
    slope = abs(far - near) / (FOLLOWED_RAD[1] - FOLLOWED_RAD[0])
    return max(0.0, float(abs(near - branch.handle[0]) - slope * FOLLOWED_RAD[0]))


def deadband(branch: Branch) -> float:
    """Handle travel near the middle of a branch during which the bend stands still [rad].

    It is the largest jump of h(theta), over what the slopes beside it explain: after a reversal the
    bend stands still too, but that is at the end of a branch. Zero below `SMALLEST_RAD`.
    """
    centres = np.arange(-MIDDLE_RAD, MIDDLE_RAD, WINDOW_RAD / 4)
    largest = max(_jump(branch, float(centre)) for centre in centres)
    return largest if largest >= SMALLEST_RAD else 0.0


def _jump(branch: Branch, centre: float) -> float:
    far, near = WINDOW_RAD + BESIDE_RAD, WINDOW_RAD
    edges = [branch.passes(centre + offset) for offset in (-far, -near, near, far)]
    if any(edge is None for edge in edges):
        return 0.0
    below, left, right, above = np.abs(np.array(edges, float) - float(edges[0] or 0.0))
    beside = (left - below + above - right) / (2 * BESIDE_RAD)
    return float(right - left - 2 * WINDOW_RAD * beside)
