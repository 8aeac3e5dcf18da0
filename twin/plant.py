"""The simulated endoscope in front of its board: MuJoCo state, stepped on a grid."""

from __future__ import annotations

from math import radians
from typing import NamedTuple

import mujoco
import numpy as np

from endolock.hw.api import ConfigError, Plant, Pose, Vector
from endolock.twin import scene
from endolock.twin import transmission as cable
from endolock.twin.instrument import Instrument, Numerics
from endolock.twin.scenario import Scenario

_FLIP = np.array([1.0, -1.0, -1.0])
"""From MuJoCo's camera axes (right, up, back) to OpenCV's (right, down, ahead), by column."""


_UNSTABLE = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


class Snapshot(NamedTuple):
    """Raw copies out of the physics, in world axes, taken where working them out would cost."""

    t: float
    camera_position: Vector
    camera_matrix: Vector
    backbone: Vector
    tensions: list[float]
    board: tuple[float, float, float]


class TwinPlant:
    """Section, wires, handles and board of one scenario.

    Args:
        scenario: tells the bend of the shaft and how the board moves.
        instrument: what the section is made of.
        numerics: how finely it is simulated.
    """

    def __init__(self, scenario: Scenario, instrument: Instrument, numerics: Numerics) -> None:
        self.instrument = instrument
        self._scenario = scenario
        spec = scene.build(instrument, numerics)
        camera = scenario.camera
        spec.visual.global_.offwidth = max(640, camera.width)
        spec.visual.global_.offheight = max(480, camera.height)
        spec.camera("tip").fovy = camera.fovy_deg
        behind = scenario.board.distance_m + scene.WALL_DISTANCE_M
        spec.geom("wall").pos[0] = scene.camera_at_rest(instrument)[0] + behind
        self.model: mujoco.MjModel = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._origin = scene.camera_at_rest(instrument)
        self._tip = scene.camera_id(self.model, "tip")
        model = self.model
        rings = [model.body(i).id for i in range(model.nbody) if "ring_" in model.body(i).name]
        self._backbone = [model.body("base").id, *rings, model.body("tip").id]
        self._transmission = cable.Transmission(model, instrument)
        self._refresh_steps = round(cable.REFRESH_S / model.opt.timestep)

        mujoco.mj_resetDataKeyframe(model, self.data, model.key("home").id)
        slide = cable.rest_slide(instrument, self.shaft_bend_rad)
        for wire in cable.WIRES:
            self.data.joint(f"slide_{wire}").qpos = slide
        self.step_count = 0
        self.timestep_s = float(model.opt.timestep)
        self._transmission.refresh(self.data, self.shaft_bend_rad)
        self._current_at = 0

    @property
    def shaft_bend_rad(self) -> float:
        """Present bend of the shaft [rad]."""
        return radians(self._scenario.shaft_bend_deg)

    @property
    def t(self) -> float:
        """Present time [s]."""
        return self.step_count * self.timestep_s

    def advance(self, step: int) -> None:
        """Step the physics up to a grid point, renewing the wire friction every 10 ms."""
        while self.step_count < step:
            phase = self.step_count % self._refresh_steps
            n = min(step - self.step_count, self._refresh_steps - phase)
            mujoco.mj_step(self.model, self.data, n)
            self.step_count += n
            if self.step_count % self._refresh_steps == 0:
                self._transmission.refresh(self.data, self.shaft_bend_rad)
                self._current_at = self.step_count
        if any(self.data.warning[kind].number for kind in _UNSTABLE):
            raise ConfigError(
                f"the simulation became unstable before t = {self.t:.3f} s; use softer or heavier "
                "parts, or a smaller timestep"
            )

    def board_position(self) -> tuple[float, float, float]:
        """Present position of the board's centre in the base frame [m]."""
        right, down = self._scenario.offset(self.t)
        return right, down, self._scenario.board.distance_m

    def draw_board(self) -> None:
        """Put the board and its picture's camera and lights where they are now, for rendering."""
        self.data.mocap_pos[0] = self._origin + scene.WORLD_FROM_BASE @ self.board_position()
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def snapshot(self) -> Snapshot:
        """Copy what the truth about this moment follows from."""
        model, data = self.model, self.data
        if self._current_at != self.step_count:
            cable.update_lengths(model, data)
            self._current_at = self.step_count
        mujoco.mj_camlight(model, data)
        return Snapshot(
            self.t,
            data.cam_xpos[self._tip].copy(),
            data.cam_xmat[self._tip].copy(),
            data.xpos[self._backbone],
            self._transmission.tensions(data),
            self.board_position(),
        )

    def explain(self, moment: Snapshot) -> tuple[Plant, Vector]:
        """Work a snapshot out.

        Returns:
            The state of the plant, and the tip camera's orientation (3x3, base_from_camera).
        """
        position = self._in_base(moment.camera_position)
        world = moment.camera_matrix.reshape(3, 3)
        rotation: Vector = scene.WORLD_FROM_BASE.T @ world * _FLIP
        quaternion, vector = np.empty(4), np.empty(3)
        mujoco.mju_mat2Quat(quaternion, rotation.ravel())
        mujoco.mju_quat2Vel(vector, quaternion, 1.0)
        x, y, z = position.tolist()
        qw, qx, qy, qz = quaternion.tolist()
        up_down, left_right, _ = vector.tolist()
        plant = Plant(
            bend_rad=(up_down, left_right),
            tip=Pose(t=moment.t, position=(x, y, z), quaternion=(qw, qx, qy, qz)),
            board=Pose(t=moment.t, position=moment.board, quaternion=(1.0, 0.0, 0.0, 0.0)),
            backbone=np.append(self._in_base(moment.backbone), [position], axis=0),
            tension_handle_n=tuple(moment.tensions[:4]),
            tension_section_n=tuple(moment.tensions[4:]),
        )
        return plant, rotation

    def _in_base(self, world: Vector) -> Vector:
        points: Vector = (world - self._origin) @ scene.WORLD_FROM_BASE
        return points
