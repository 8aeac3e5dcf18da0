"""Widths and deadband of a recorded hysteresis loop.

A branch is a stroke of the handle in one direction. The handle angle h(theta) at which it passes a
bend theta is found by counting: with the bend rising, it is the branch's last handle angle less the
travel during which the bend was above theta. Noise on either side cancels; nothing is smoothed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from endolock.hw.api import Vector

MIDDLE_RAD = np.radians(10.0)
"""Range of bends, +- this, in which a deadband is searched for [rad]."""
WINDOW_RAD = np.radians(0.5)
"""Bend on either side of a deadband that counts as inside [rad]: ten times a tracker's noise."""
FOLLOWED_RAD = np.radians([8.0, 12.0])
"""Range of bends after a reversal in which the bend follows the handle [rad]: before it, part of
the cable still sticks."""
SMALLEST_RAD = 0.01
"""Smallest deadband that can be distinguished from noise and curvature [rad]."""
BESIDE_RAD = np.radians(4.0)
"""Range of bends over which the slopes beside a deadband are measured [rad]."""


@dataclass(frozen=True)
class Branch:
    """A stroke of one handle in one direction.

    Args:
        handle: handle angles [rad], rising or falling throughout.
        bend: bends of the same axis at the same times [rad].
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
        # rising: the bend is above at the end of the branch; falling: at its start
        rising = self.bend[-1] > self.bend[0]
        return float(self.handle[-1] - travel if rising else self.handle[0] + travel)


def width(falling: Branch, rising: Branch, bend_rad: float) -> float | None:
    """Handle travel between two branches at a bend [rad]; None if one does not pass it."""
    down, up = falling.passes(bend_rad), rising.passes(bend_rad)
    return None if down is None or up is None else abs(down - up)


def lost_after_turn(branch: Branch) -> float | None:
    """Handle travel after the reversal at the start of a branch before the bend follows [rad].

    It is found by extrapolating the line through the two bends `FOLLOWED_RAD` from the start back
    to the bend at the start; None if the branch is too short.
    """
    start = float(np.mean(branch.bend[:5]))
    near, far = (
        branch.passes(start + np.copysign(bend, branch.bend[-1] - start)) for bend in FOLLOWED_RAD
    )
    if near is None or far is None:
        return None
    slope = abs(far - near) / (FOLLOWED_RAD[1] - FOLLOWED_RAD[0])
    return max(0.0, float(abs(near - branch.handle[0]) - slope * FOLLOWED_RAD[0]))


def deadband(branch: Branch) -> float:
    """Handle travel near the middle of a branch during which the bend is constant [rad].

    It is the largest jump of h(theta) beyond the slopes on both sides. After a reversal the bend is
    constant too, but at the end of a branch. Zero below `SMALLEST_RAD`.
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
