"""Loops that are believed without a background.

The target's own motion may look like a loop, so a loop is believed once it is evident
(control/predictive/loop_evidence.py). It is kept, with its weights, until newer frames speak
clearly against them: a handle at rest, or one that turns smoothly, tells nothing. Both wires of an
instrument pass the same shaft: a loop that is evident in one axis is believed in the other as well,
where nothing speaks against it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from endolock.control.predictive.handle_history import PRIOR
from endolock.control.predictive.loop_evidence import CLEARLY, NEARLY
from endolock.control.predictive.online_plays import IdentifiedAxis
from endolock.hw.api import Vector


class LoopBelief:
    """Weights of the columns of both axes, and which of them are believed."""

    def __init__(self) -> None:
        self.weights = np.array([PRIOR] * 2)
        """Weights that are believed, 2 x `COLUMNS` [rad/rad]; no loop where none is."""
        self.width_std = np.full(2, np.pi)
        """Standard deviation of their mean widths, 2 [rad]."""
        self.known = [False, False]
        """Whether the loop of each axis is believed."""
        self._own = [False, False]

    def adopt(self, axis: int, weights: Vector) -> None:
        """Believe in weights that were found otherwise, `COLUMNS` [rad/rad]."""
        self.weights[axis] = weights
        self.known[axis] = self._own[axis] = True

    def renew(self, axes: Sequence[IdentifiedAxis | None]) -> None:
        """Believe and doubt by what was identified of each axis, None where it was at rest."""
        for axis, found in enumerate(axes):
            if found is None:
                continue
            if found.loop.evident:
                self.adopt(axis, found.weights)
                self.width_std[axis] = found.width_std
            elif self._own[axis] and not found.allows(self.weights[axis], CLEARLY):
                self._own[axis] = False
        for axis, found in enumerate(axes):
            if not self._own[axis]:
                self._share(axis, found)

    def _share(self, axis: int, found: IdentifiedAxis | None) -> None:
        """Believe in an axis what is believed of the other, or nothing."""
        odds = CLEARLY if self.known[axis] else NEARLY
        others = self.weights[1 - axis]
        self.known[axis] = self._own[1 - axis] and (found is None or found.allows(others, odds))
        self.weights[axis] = others if self.known[axis] else PRIOR
        self.width_std[axis] = self.width_std[1 - axis] if self.known[axis] else np.pi
