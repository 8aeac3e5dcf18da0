"""History of the handles, and of the columns from which a bend is made of them.

A column is a play behind a dead zone of the handle angle h, with one memory z per axis:

    d(h) = max(h - s, 0) + min(h + s, 0),        z <- min(max(z, d(h) - r), d(h) + r).

With s = 0 it is a plain play, with r = 0 a dead zone without memory: friction, slack, or friction
behind slack. A bend is a weighted sum of columns with weights >= 0, so it never falls while the
handle rises.
"""

from __future__ import annotations

import numpy as np

from endolock.control.transmission.kinematics import Pair
from endolock.control.transmission.linear_process import BEND_PER_HANDLE
from endolock.hw.api import Vector

PLAYS = 12
"""Number of plain plays, the first columns."""
RADII = np.array(
    [0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7]
    + [0.0] * 4
    + [0.1, 0.2, 0.3] * 3
)
"""Half-width r of each column's play [rad], for loops of up to 0.45 of 180 deg."""
SLACKS = np.array([0.0] * PLAYS + [0.1, 0.2, 0.3, 0.45] + [0.1] * 3 + [0.2] * 3 + [0.3] * 3)
"""Half-width s of each column's dead zone [rad]. Assumed: slack of up to 50 deg at the handle."""
COLUMNS = len(RADII)
"""Number of columns."""
HALF_WIDTHS = RADII + SLACKS
"""Half of the handle's way through each column [rad]."""
PRIOR = np.array([BEND_PER_HANDLE, *[0.0] * (COLUMNS - 1)])
"""Weights without any knowledge [rad/rad]: no hysteresis, as over-compensation loses targets."""
ROOM = 4096
"""Number of ticks for which there is room: 80 s; a quarter is dropped when it is full."""


class HandleHistory:
    """Handle angles and columns of both axes at the ticks.

    Args:
        handles: handle angles at the start [rad], on which the plays are centred.
    """

    def __init__(self, handles: Pair) -> None:
        self._times = np.zeros(ROOM)
        self._handles = np.zeros((ROOM, 2))
        self._columns = np.zeros((ROOM, 2, COLUMNS))
        self._count = 0
        self.handles = np.array(handles)
        """Newest handle angles [rad]."""
        self.outputs = _behind_slack(self.handles)
        """Newest columns, 2 x `COLUMNS` [rad]."""

    @property
    def times(self) -> Vector:
        """Times of the ticks, n [s]."""
        return self._times[: self._count]

    @property
    def angles(self) -> Vector:
        """Handle angles at the ticks, n x 2 [rad]."""
        return self._handles[: self._count]

    @property
    def columns(self) -> Vector:
        """Columns at the ticks, n x 2 x `COLUMNS` [rad]."""
        return self._columns[: self._count]

    def follow(self, t: float, handles: Pair) -> None:
        """Add the measured handle angles of one tick [rad]; one that is not newer is ignored."""
        n = self._count
        if n and t <= self._times[n - 1]:
            return
        if n == ROOM:
            n -= ROOM // 4
            for array in (self._times, self._handles, self._columns):
                array[:n] = array[ROOM // 4 :].copy()
        self.handles = np.array(handles)
        d = _behind_slack(self.handles)
        self.outputs = np.minimum(np.maximum(self.outputs, d - RADII), d + RADII)
        self._times[n], self._handles[n] = t, handles
        self._columns[n] = self.outputs
        self._count = n + 1

    def columns_at(self, t: Vector) -> Vector:
        """Columns at any times, between ticks by linear interpolation, m x 2 x `COLUMNS` [rad]."""
        times = self.times
        if len(times) == 1:
            return np.repeat(self.columns, len(t), axis=0)
        after = np.minimum(np.maximum(np.searchsorted(times, t), 1), len(times) - 1)
        start = times[after - 1]
        share = (t - start) / (times[after] - start)
        share = np.minimum(np.maximum(share, 0.0), 1.0)[:, None, None]
        found: Vector = (1 - share) * self.columns[after - 1] + share * self.columns[after]
        return found

    def sums_at(self, t: Vector, weights: Vector) -> Vector:
        """Weighted sums of the columns at any times, as `columns_at`, m x 2 [rad].

        Args:
            t: times, 1 or more [s].
            weights: weights of the columns, 2 x `COLUMNS` [rad/rad].
        """
        first = max(int(np.searchsorted(self.times, t.min())) - 1, 0)
        last = int(np.searchsorted(self.times, t.max())) + 1
        sums = np.einsum("ak,nak->an", weights, self.columns[first:last])
        return np.column_stack([np.interp(t, self.times[first:last], one) for one in sums])


def _behind_slack(handles: Vector) -> Vector:
    """Handle angles behind the dead zone of each column, 2 x `COLUMNS` [rad]."""
    h = handles[:, None]
    behind: Vector = h - np.minimum(np.maximum(h, -SLACKS), SLACKS)
    return behind


def handle_for(
    weights: Vector, outputs: Vector, handle: float, bend: float, *, reach: float
) -> float:
    """Nearest handle angle at which the columns of one axis give a bend [rad].

    The bend is piecewise linear in the handle angle, from the present state of the plays.

    Args:
        weights: weight of each column, `COLUMNS` [rad/rad], >= 0, not all 0.
        outputs: present columns of the axis, `COLUMNS` [rad].
        handle: present handle angle [rad].
        bend: desired bend [rad].
        reach: largest handle angle [rad].
    """
    used: list[tuple[float, float, float, float]] = [
        (weights.item(n), RADII.item(n), SLACKS.item(n), outputs.item(n))
        for n in weights.nonzero()[0].tolist()
    ]

    def bend_at(h: float) -> float:
        bend = 0.0
        for w, r, s, z in used:
            d = max(h - s, 0.0) + min(h + s, 0.0)
            bend += w * min(max(z, d - r), d + r)
        return bend

    present = bend_at(handle)
    if bend == present:
        return handle
    # The play moves once d(h) = z +- r; the dead zone begins and ends at +-s.
    edges = [z + side * r for _, r, _, z in used for side in (-1, 1)]
    edges = [
        edge + (s if edge > 0 else -s)
        for edge, s in zip(edges, [s for _, _, s, _ in used for _ in (0, 1)], strict=True)
    ]
    edges += [side * s for _, _, s, _ in used if s for side in (-1, 1)]
    way = 1.0 if bend > present else -1.0
    ahead = [edge for edge in edges if way * edge > way * handle and abs(edge) < reach]
    last, at = present, handle
    for corner in sorted([*ahead, way * reach], reverse=way < 0):
        there = bend_at(corner)
        if way * there >= way * bend:
            return at + (bend - last) / (there - last) * (corner - at)
        last, at = there, corner
    return way * reach
