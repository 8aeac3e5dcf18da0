"""Loops that are believed without a background.

The target's own motion may look like a loop, so a loop is believed once it is evident
(control/predictive/loop_evidence.py). It is kept, with its weights, until newer frames speak
clearly against them: a handle at rest, or one that turns smoothly, tells nothing. Both wires of an
instrument pass the same shaft: the loop of the axis with more evidence is believed in the other as
well, where nothing speaks against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

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
        self._found = self.weights.copy()
        self._std = np.full(2, np.pi)
        self._gain = [0.0, 0.0]

    def adopt(self, axis: int, weights: Vector, width_std: float) -> None:
        """Believe in weights that were found otherwise, with the std of their width [rad]."""
        self._found[axis] = self.weights[axis] = weights
        self._std[axis] = self.width_std[axis] = width_std
        self.known[axis] = self._own[axis] = True
        self._gain[axis] = inf

    def renew(self, axes: Sequence[IdentifiedAxis | None], *, doubt: bool = True) -> None:
        """Believe and doubt by what was identified.

        Args:
            axes: each axis, None where it was at rest.
            doubt: whether what is believed may be dropped.
        """
        for axis, found in enumerate(axes):
            if found is None:
                continue
            if found.loop.evident:
                self._own[axis] = True
                self._found[axis], self._std[axis] = found.weights, found.width_std
                self._gain[axis] = found.loop.gain
            elif doubt and self._own[axis] and not found.allows(self._found[axis], CLEARLY):
                self._own[axis] = False
        for axis, found in enumerate(axes):
            self._choose(axis, found)

    def _choose(self, axis: int, found: IdentifiedAxis | None) -> None:
        """Believe in what was found of an axis, of the other one, or nothing."""
        other, own = 1 - axis, self._own[axis]
        odds = CLEARLY if self.known[axis] and not own else NEARLY
        alike = self._own[other] and (found is None or found.allows(self._found[other], odds))
        if own and (found is None or self._gain[axis] >= self._gain[other]):
            alike = False  # better known by itself
        self.known[axis] = own or alike
        source = other if alike else axis
        self.weights[axis] = self._found[source] if self.known[axis] else PRIOR
        self.width_std[axis] = self._std[source] if self.known[axis] else np.pi
