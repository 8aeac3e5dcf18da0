"""Rotation of the camera from frame to frame, measured beside the board, or beside a window.

Where the board is not found, it is taken to be where it was last seen, carried by the camera's own
rotation since then, within a rim that grows at `BOARD_SPEED_M_S`. So it soon covers the picture,
unless it is known to be far outside.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from endolock.hw import rotation
from endolock.hw.api import Calibration, Frame, Vector
from endolock.vision.background import Mask
from endolock.vision.board_pose import BoardPose
from endolock.vision.ego_motion import LEVER_M, EgoMotion
from endolock.vision.observation import Turn

BOARD_SPEED_M_S = 0.10
"""Growth of the rim around a board that is not found [m/s]. Assumed: the fastest strokes of the
thesis reach 0.05 m/s, and the camera's rotation moves the board by as much."""
NOT_SEEN = "the board has not been seen yet"
"""Refusal of a picture of which nothing is known."""


class _Sighting(NamedTuple):
    """Where the board was last seen, in the present axes of the camera."""

    t: float
    rotation: Vector
    translation: Vector


class Turning:
    """Measures rotations for eyes that know where the board is.

    Args:
        calibration: the camera's geometry.
        size_m: side of the square board [m].
        lever_m: see `ego_motion.LEVER_M`.
    """

    def __init__(self, calibration: Calibration, size_m: float, lever_m: float = LEVER_M) -> None:
        self._motion, self._size_m = EgoMotion(calibration, lever_m), size_m
        self._lever_m = lever_m
        self._board: _Sighting | None = None
        self.why = ""
        """Reason why the last frame had no rotation; empty if it had one."""

    def __call__(
        self,
        frame: Frame,
        board: BoardPose | None,
        window: tuple[tuple[float, float], float] | None = None,
    ) -> Turn | None:
        """Compare a frame with the last one that could be used.

        Args:
            frame: the newest frame.
            board: pose of the board in it; None if it was not found.
            window: centre (u, v) and half side [px] of a window to leave out as long as no board
                was found.
        """
        if board is not None:
            self._board = _Sighting(frame.t_capture, board.rotation, board.translation)
        mask = self._mask(frame.t_capture, window)
        turn = NOT_SEEN if mask is None else self._motion(frame, mask)
        if isinstance(turn, str):
            self.why = turn
            return None
        self.why = ""
        if board is None:
            self._carry(turn)
        return turn

    def _mask(self, t: float, window: tuple[tuple[float, float], float] | None) -> Mask | None:
        background = self._motion.background
        if self._board is None:
            return background.beside_window(*window) if window else None
        seen_t, turned, centre = self._board
        margin_m = BOARD_SPEED_M_S * max(0.0, t - seen_t)
        return background.beside_board(turned, centre, self._size_m, margin_m)

    def _carry(self, turn: Turn) -> None:
        """Express the last sighting in the axes of the camera after a rotation."""
        if self._board is None:
            return
        seen_t, turned, centre = self._board
        back = rotation.to_matrix(rotation.from_vector(turn.vector)).T
        x, y, _ = turn.vector
        moved = self._lever_m * np.array([y, -x, 0.0])
        self._board = _Sighting(seen_t, back @ turned, back @ (centre - moved))
