"""The model of the transmission in use: a weighted sum of columns, or the capstan.

The bend of each axis is a sum of plays and dead zones of its handle
(control/predictive/handle_history.py), or both bends come from the capstan model of both axes
(control/predictive/capstan_model.py), turned into the axes of the video.
"""

from __future__ import annotations

import numpy as np

from endolock.control.predictive import capstan_model, handle_history
from endolock.control.predictive.capstan_model import CapstanModel
from endolock.control.predictive.handle_history import HALF_WIDTHS, PRIOR, HandleHistory
from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Vector


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
        self.capstan = CapstanModel()
        """The capstan model, and the search for it."""
        self.capstan_used = False
        """Whether the capstan is used instead of the columns."""

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
    def slopes(self) -> Vector:
        """Bend per handle angle of each axis in long strokes [rad/rad]."""
        return self._slopes

    @property
    def bend(self) -> Vector:
        """Present bend by the model, in axes of the video [rad]."""
        if self.capstan_used:
            bend: Vector = self.capstan.bends[-1] @ self._turned()
        else:
            bend = np.einsum("ak,ak->a", self.weights, self.history.columns[-1])
        return bend

    def follow(self, t: float, handles: Pair) -> None:
        """Run all models on measured handle angles."""
        self.history.follow(t, handles)
        self.capstan.follow(self.history)

    def bends_at(self, t: Vector) -> Vector:
        """Bends by the model at past times, in axes of the video, n x 2 [rad]."""
        if self.capstan_used:
            bends: Vector = self.capstan.bends_at(self.history, t) @ self._turned()
        else:
            bends = self.history.sums_at(t, self.weights)
        return bends

    def handles_for(self, bend: Pair, reach: float) -> Pair:
        """Nearest handle angles at which the model has a bend, in axes of the video [rad]."""
        up_down, left_right = self.history.handles.tolist()
        if self.capstan_used:
            one, two = (self._turned() @ bend).tolist()
            return self.capstan.handles_for((one, two), (up_down, left_right))
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

    def _turned(self) -> Vector:
        """Rotation from axes of the video to those of the wires, 2 x 2."""
        angle = self.capstan.search.parameters.video_turn_rad if self.capstan_used else 0.0
        return capstan_model.rotation(angle)
