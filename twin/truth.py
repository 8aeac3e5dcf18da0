"""What only the simulation knows: exact projections and plant states, now and at each exposure."""

from __future__ import annotations

from math import degrees, pi

from endolock.hw.api import BoardGeometry, Calibration, TruthSample
from endolock.twin.plant import TwinPlant
from endolock.vision import camera_model


class TwinTruth:
    """Access to the truth of one twin.

    Args:
        plant: whose truth it is.
        calibration: of the tip camera.
        board: tells where on the board the target is.
        remember: so many exposures are kept; older ones are forgotten.
    """

    def __init__(
        self, plant: TwinPlant, calibration: Calibration, board: BoardGeometry, remember: int
    ) -> None:
        self._plant, self._calibration = plant, calibration
        self._target = (*board.target, 0.0)
        self._remember = remember
        self._exposures: dict[int, TruthSample] = {}
        self._newest: tuple[int, TruthSample] | None = None

    def now(self) -> TruthSample:
        """Return the truth at the clock's present time."""
        if self._newest is None or self._newest[0] != self._plant.step_count:
            self._newest = self._plant.step_count, self._sample()
        return self._newest[1]

    def at_exposure(self, seq: int) -> TruthSample:
        """Return the truth at the exposure of a frame; see `Truth.at_exposure`."""
        try:
            return self._exposures[seq]
        except KeyError:
            known = f"{min(self._exposures)}..{max(self._exposures)}" if self._exposures else "none"
            raise LookupError(f"no truth for frame {seq}; remembered are {known}") from None

    def expose(self, seq: int) -> None:
        """Remember the truth of the exposure that happens now."""
        self._exposures[seq] = self.now()
        self._exposures.pop(seq - self._remember, None)

    def _sample(self) -> TruthSample:
        plant = self._plant
        plant.move_board()
        position, rotation = plant.camera_pose()
        point = rotation.T @ (plant.board_position() + self._target - position)
        pixel = camera_model.project(self._calibration, point)
        ahead = bool(point[2] > 0)
        angle = camera_model.off_axis_angle(self._calibration, pixel) if ahead else pi
        return TruthSample(
            t=plant.t,
            target_px=pixel,
            in_picture=camera_model.in_picture(self._calibration, pixel),
            distance_m=float(point[2]),
            error_deg=degrees(angle),
            plant=plant.state(),
        )
