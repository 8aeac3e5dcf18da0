"""Ground truth of a simulation: exact projections and plant states, now and at each exposure."""

from __future__ import annotations

from math import degrees, pi
from typing import Any, Protocol

import numpy as np

from endolock.hw.api import BoardGeometry, Calibration, Plant, TruthSample, Vector
from endolock.twin.world.playback import Course
from endolock.vision import camera_model


class Source(Protocol):
    """A plant that takes raw snapshots and computes the truth from them when needed."""

    course: Course
    """Its occluders may hide the target."""
    base_from_board: Vector
    """Orientation of the board, 3x3."""

    def snapshot(self) -> Any:
        """Copy the state from which the truth at this time is computed."""

    def explain(self, moment: Any) -> tuple[Plant, Vector]:
        """Compute the truth of a snapshot: state of the plant, and camera orientation, 3x3."""


class TwinTruth:
    """Ground truth of one simulated rig.

    Args:
        plant: the simulated plant.
        calibration: calibration of the tip camera.
        board: its target is projected.
        remember: number of exposures to keep.
    """

    def __init__(
        self, plant: Source, calibration: Calibration, board: BoardGeometry, remember: int
    ) -> None:
        self._plant, self._calibration = plant, calibration
        self.target = (*board.target, 0.0)
        """Target on the board (right, down, 0) [m]."""
        self._remember = remember
        self._exposures: dict[int, Any] = {}

    def now(self) -> TruthSample:
        """Return the truth at the present time of the clock."""
        return self._explain(self._plant.snapshot())

    def expose(self, seq: int) -> None:
        """Remember the present state as the exposure of a frame."""
        self._exposures[seq] = self._plant.snapshot()
        self._exposures.pop(seq - self._remember, None)

    def at_exposure(self, seq: int) -> TruthSample:
        """Return the truth at the exposure of a frame; see `Truth.at_exposure`."""
        if seq not in self._exposures:
            known = f"{min(self._exposures)}..{max(self._exposures)}" if self._exposures else "none"
            raise LookupError(f"no truth for frame {seq}; known frames: {known}")
        moment = self._exposures[seq]
        if not isinstance(moment, TruthSample):
            moment = self._exposures[seq] = self._explain(moment)
        return moment

    def _explain(self, moment: Any) -> TruthSample:
        plant, rotation = self._plant.explain(moment)
        target = np.add(moment.board, self._plant.base_from_board @ self.target)
        point = (target - plant.tip.position) @ rotation
        pixel = camera_model.project(self._calibration, point)
        ahead = bool(point[2] > 0)
        angle = camera_model.off_axis_angle(self._calibration, pixel) if ahead else pi
        return TruthSample(
            t=moment.t,
            target_px=pixel,
            in_picture=camera_model.in_picture(self._calibration, pixel),
            hidden=self._plant.course.hides(moment.t, plant.tip.position, target),
            distance_m=float(point[2]),
            error_deg=degrees(angle),
            plant=plant,
        )
