"""The model of the transmission in use: a weighted sum of columns, or the capstan.

The bend of each axis is a sum of plays and dead zones of its handle
(control/predictive/handle_history.py), or both bends come from the capstan model of both axes
(control/predictive/capstan_model.py). Handles move bends in axes of the wires; what was seen, and
bends at past times to compare with it, are in axes of the video.
"""

from __future__ import annotations

import numpy as np

from endolock.control.predictive import capstan_model, handle_history
from endolock.control.predictive.capstan_model import CapstanModel
from endolock.control.predictive.handle_history import HALF_WIDTHS, PRIOR, HandleHistory
from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Vector

WIDTHS_EVERY_S = 0.5
"""Time between computations of the capstan's loop widths [s]."""
UNKNOWN_RAD = 0.2
"""Standard deviation of a width above which it is not known [rad]. Assumed: a third of a loop."""


class ModelInUse:
    """Handle angles, both models that follow them, and which of the two is in use.

    Args:
        t: present time [s].
        handles: present handle angles, at which everything is at rest [rad].
    """

    def __init__(self, t: float, handles: Pair) -> None:
        self.history = HandleHistory(handles)
        """Handle angles and columns of the past."""
        self.history.follow(t, handles)
        self.weights = np.array([PRIOR, PRIOR])
        self.turn_rad = 0.0
        """Rotation of the video about its optical axis, used with the columns [rad]."""
        self.capstan = CapstanModel()
        """The capstan model, and the search for it."""
        self.capstan_used = False
        """Whether the capstan is used instead of the columns."""
        self.width_std = np.full(2, np.pi)
        """Standard deviation of the mean loop width of each axis [rad]."""
        self._capstan_widths = np.zeros(2)
        self._widths_due_s = t

    @property
    def weights(self) -> Vector:
        """Weights of the columns in use, 2 x `COLUMNS` [rad/rad]; they are replaced as a whole."""
        return self._weights

    @weights.setter
    def weights(self, weights: Vector) -> None:
        self._weights = weights
        weights.flags.writeable = False
        self._slopes: Vector = np.maximum(weights.sum(axis=1), 0.1)
        self._widths: Vector = 2 * (weights @ HALF_WIDTHS) / self._slopes

    @property
    def widths(self) -> Vector:
        """Mean full loop width of each axis [rad]."""
        return self._widths

    @property
    def likely_widths(self) -> Vector:
        """Loop width of each axis, by the other axis where one has not moved enough, 2 [rad]."""
        if self.capstan_used:
            return self._capstan_widths
        unknown = self.width_std > UNKNOWN_RAD
        return np.where(unknown, np.maximum(self.widths, self.widths[::-1]), self.widths)

    @property
    def slopes(self) -> Vector:
        """Bend per handle angle of each axis in long strokes [rad/rad]."""
        return self._slopes

    @property
    def bend(self) -> Vector:
        """Present bend by the model, in axes of the wires, 2 [rad]."""
        if self.capstan_used:
            bend: Vector = self.capstan.bends[-1].copy()  # of memory that is used again
        else:
            bend = np.einsum("ak,ak->a", self.weights, self.history.columns[-1])
        return bend

    def follow(self, t: float, handles: Pair) -> None:
        """Run all models on measured handle angles [rad]; ones that are not newer are ignored."""
        if t <= self.history.times[-1]:
            return
        self.history.follow(t, handles)
        self.capstan.follow(self.history)
        if self.capstan_used and t >= self._widths_due_s:
            self._widths_due_s = t + WIDTHS_EVERY_S
            up_down, left_right = self.history.handles.tolist()
            self._capstan_widths = np.array(self.capstan.widths((up_down, left_right)))

    def bends_at(self, t: Vector) -> Vector:
        """Bends by the model at past times, in axes of the video, n x 2 [rad]."""
        if self.capstan_used:
            bends = self.capstan.bends_at(self.history, t)
        else:
            bends = self.history.sums_at(t, self.weights)
        return bends @ self._turned()

    def handles_for(self, bend: Pair, reach: float) -> Pair:
        """Nearest handle angles at which the model has a bend, in axes of the wires [rad]."""
        up_down, left_right = self.history.handles.tolist()
        if self.capstan_used:
            return self.capstan.handles_for(bend, (up_down, left_right))
        first, second = (
            handle_history.handle_for(
                self.weights[axis],
                self.history.outputs[axis],
                handle,
                bend[axis],
                reach=reach,
            )
            for axis, handle in enumerate((up_down, left_right))
        )
        return first, second

    def to_wires(self, bends: Vector) -> Vector:
        """Turn bends from axes of the video to those of the wires, 2 or n x 2 [rad]."""
        turned: Vector = bends @ self._turned().T
        return turned

    def _turned(self) -> Vector:
        """Rotation from axes of the video to those of the wires, 2 x 2."""
        found = self.capstan.search.parameters.video_turn_rad
        return capstan_model.rotation(found if self.capstan_used else self.turn_rad)
