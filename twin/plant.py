"""The simulated endoscope in front of its board: MuJoCo state, stepped on a grid."""

from __future__ import annotations

from math import radians

import mujoco
import numpy as np

from endolock.hw.api import Plant, Pose, Vector
from endolock.twin import scene
from endolock.twin import transmission as cable
from endolock.twin.instrument import Instrument, Numerics
from endolock.twin.scenario import Scenario

_MUJOCO_FROM_OPENCV = np.diag([1.0, -1.0, -1.0])


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
        self.move_board()

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

    def board_position(self) -> Vector:
        """Present position of the board's centre in the base frame [m]."""
        right, down = self._scenario.offset(self.t)
        return np.array([right, down, self._scenario.board.distance_m])

    def move_board(self) -> None:
        """Put the drawn board where it is now and bring cameras and lights up to date."""
        self.data.mocap_pos[0] = self._origin + scene.WORLD_FROM_BASE @ self.board_position()
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def camera_pose(self) -> tuple[Vector, Vector]:
        """Position [m] and orientation (3x3, base_from_camera) of the tip camera in base axes.

        Kinematics must be current, as after `move_board`.
        """
        world = self.data.cam_xmat[self._tip].reshape(3, 3)
        rotation: Vector = scene.WORLD_FROM_BASE.T @ world @ _MUJOCO_FROM_OPENCV
        return self._in_base(self.data.cam_xpos[self._tip]), rotation

    def state(self) -> Plant:
        """Everything true about the plant at this moment; kinematics must be current."""
        mujoco.mj_tendon(self.model, self.data)
        position, rotation = self.camera_pose()
        quaternion, vector = np.empty(4), np.empty(3)
        mujoco.mju_mat2Quat(quaternion, rotation.ravel())
        mujoco.mju_quat2Vel(vector, quaternion, 1.0)
        tensions = self._transmission.tensions(self.data)
        x, y, z = (float(v) for v in self.board_position())
        return Plant(
            bend_rad=(float(vector[0]), float(vector[1])),
            tip=Pose(t=self.t, position=_triple(position), quaternion=_quadruple(quaternion)),
            board=Pose(t=self.t, position=(x, y, z), quaternion=(1.0, 0.0, 0.0, 0.0)),
            backbone=np.vstack([self._in_base(self.data.xpos[self._backbone]), position]),
            tension_handle_n=tuple(tensions[:4]),
            tension_section_n=tuple(tensions[4:]),
        )

    def _in_base(self, world: Vector) -> Vector:
        points: Vector = (world - self._origin) @ scene.WORLD_FROM_BASE
        return points


def _triple(v: Vector) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])


def _quadruple(v: Vector) -> tuple[float, float, float, float]:
    return float(v[0]), float(v[1]), float(v[2]), float(v[3])
