"""Stills of a board at any pose, with the exact pixel of its target as ground truth.

The section stays straight, so the camera is at the origin of the base frame. Scene and optics are
those of the twin.
"""

from __future__ import annotations

from math import cos, radians, sin
from typing import NamedTuple

import mujoco
import numpy as np

from endolock.hw import boards, rotation
from endolock.hw.api import Frame, Image, Vector
from endolock.hw.lifecycle import Closing
from endolock.twin.camera import optics, renderer, stage
from endolock.twin.model import scene
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.scenario import Scenario
from endolock.vision import camera_model


class BoardPose(NamedTuple):
    """Pose of a board in camera axes."""

    position: tuple[float, float, float]
    """Position of its centre (right, down, ahead) [m]."""
    tilt_deg: float = 0.0
    axis_deg: float = 0.0
    """See `scenario_sections.Board`."""
    roll_deg: float = 0.0
    """Rotation within its plane, clockwise in the picture [deg]."""


class BoardStill(NamedTuple):
    """A picture and its ground truth."""

    frame: Frame
    target_px: tuple[float, float]
    distance_m: float
    """Depth of the target [m]."""


class Studio(Closing):
    """Takes stills.

    Args:
        scenario: its board, light, camera and occluders are used; the pose of the board is given
            with each still.
        seed: seed of the sensor noise.
    """

    def __init__(self, scenario: Scenario, seed: int = 0) -> None:
        board = scenario.board
        self._plates = scenario.occluder
        self.board = boards.aimed(board.kind, board.target)
        self.calibration = optics.calibration(scenario.camera)
        self._shot = optics.shot(scenario.camera)
        self._optics = optics.Optics(scenario.camera, seed)
        spec = stage.build(scenario)
        self._origin = scene.camera_at_rest(Instrument())
        model = self._model = spec.compile()
        self._data = mujoco.MjData(model)
        self._index = scene.camera_id(model, "tip")
        self._bodies = stage.movable(model)
        self._renderer = renderer.Renderer(model)
        self._taken = 0

    def take(self, *poses: BoardPose, t: float = 0.0) -> BoardStill:
        """Take one still.

        Args:
            poses: pose of the board; several are averaged over one exposure, and the truth
                is that of the middle one.
            t: time of the still [s], at which the occluders are placed.
        """
        pictures = [self._draw(pose, t).copy() for pose in poses]
        pose = poses[len(poses) // 2]
        target = np.array([*self.board.target, 0.0])
        point = pose.position + _rotation(pose) @ target
        frame = Frame(
            image=self._optics.develop(pictures),
            t_capture=t,
            t_available=t,
            seq=self._taken,
            dropped=0,
        )
        self._taken += 1
        return BoardStill(frame, camera_model.project(self.calibration, point), float(point[2]))

    def close(self) -> None:
        """Release the OpenGL context."""
        self._renderer.close()

    def _draw(self, pose: BoardPose, t: float) -> Image:
        points = [pose.position, *(plate.position(t) for plate in self._plates)]
        data = self._data
        data.mocap_pos[self._bodies] = self._origin + points @ scene.WORLD_FROM_BASE.T
        data.mocap_quat[self._bodies[0]] = scene.board_quaternion(_rotation(pose))
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_camlight(self._model, data)
        return self._renderer.draw(data, self._index, self._shot.width, self._shot.height)


def _rotation(pose: BoardPose) -> Vector:
    """Camera_from_board, 3x3."""
    axis, tilt, roll = (radians(a) for a in (pose.axis_deg, pose.tilt_deg, pose.roll_deg))
    tilted = rotation.to_matrix(rotation.about((cos(axis), -sin(axis), 0.0), tilt))
    turned: Vector = tilted @ rotation.matrix_about_z(roll)
    return turned
