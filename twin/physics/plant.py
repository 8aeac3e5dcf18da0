"""The simulated endoscope in front of its board: MuJoCo state, stepped on a grid."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from endolock.hw import rotation
from endolock.hw.api import ConfigError, Plant, Pose, Vector
from endolock.hw.frozen import read_only
from endolock.twin.camera import stage
from endolock.twin.model import scene, wire_springs
from endolock.twin.physics import wire_friction
from endolock.twin.physics.stability import Stability
from endolock.twin.world.instrument import WIRES, Instrument, Numerics
from endolock.twin.world.joint_conditions import WALL_BEHIND_M, check_shaft
from endolock.twin.world.playback import Course
from endolock.twin.world.scenario import Scenario

GRAVITY = (0.0, 0.0, -9.81)
"""Gravity in world axes, for scenarios that have it [m/s2]."""

_CROSS = np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])


class Snapshot(NamedTuple):
    """Raw copies of the state in world axes, from which the truth is computed when needed."""

    t: float
    tip: Vector
    base: Vector
    backbone: Vector
    tensions: tuple[list[float], list[float]]
    board: tuple[float, float, float]


class TwinPlant:
    """Section, wires, handles and board of one scenario.

    Args:
        scenario: motion of shaft and board, pushes on the tip.
        instrument: parameters of the section.
        numerics: resolution of the simulation.
        seed: seed of the random motions.

    Raises:
        ConfigError: a wire would break, or not move, with the shaft bent like this, or MuJoCo
            refuses the model.
    """

    def __init__(
        self, scenario: Scenario, instrument: Instrument, numerics: Numerics, seed: int
    ) -> None:
        check_shaft(scenario, instrument)
        self.instrument = instrument
        self.course = Course(scenario, seed)
        self._tilt = scenario.board.quaternion
        self.base_from_board = read_only(rotation.to_matrix(self._tilt))
        self._distance_m = scenario.board.distance_m
        spec = stage.build(scenario, instrument, numerics)
        if scenario.gravity:
            spec.option.gravity = GRAVITY
        self._origin = scene.camera_at_rest(instrument)
        behind = self._distance_m + WALL_BEHIND_M
        spec.body("wall").pos[0] = self._origin[0] + behind
        self.model: mujoco.MjModel = _compiled(spec)
        self.data = mujoco.MjData(self.model)
        model = self.model
        self._tip, self._base = model.body("tip").id, model.body("base").id
        rings = [f"ring_{n}" for n in range(1, numerics.hinges + 1)]
        self._backbone = [model.body(name).id for name in ("base", *rings, "tip")]
        self._camera = scene.camera_id(model, "tip")
        self._turning = int(model.body("base").mocapid[0])
        self._moving = stage.movable(model)
        self._wires = wire_friction.WireFriction(model, self.data, instrument)
        self._stability = Stability(model, self.data, instrument)
        self._refresh_steps = round(wire_friction.REFRESH_S / model.opt.timestep)

        mujoco.mj_resetDataKeyframe(model, self.data, model.key("home").id)
        upright = scene.board_quaternion(self.base_from_board)
        self.data.mocap_quat[self._moving[0]] = upright
        slides = wire_springs.rest_slides(
            instrument, numerics.nodes, self.course.shaft_bend_rad(0.0)
        )
        for n, slide in enumerate(slides, 1):
            for wire in WIRES:
                self.data.joint(f"slide_{wire}_{n}").qpos = slide
        self.step_count = 0
        self.timestep_s = float(model.opt.timestep)
        self.refresh()

    @property
    def t(self) -> float:
        """Present time [s]."""
        return self.step_count * self.timestep_s

    def advance(self, step: int) -> None:
        """Step the physics up to a grid point, updating the wire friction every 10 ms.

        Raises:
            ConfigError: the simulation has diverged.
        """
        while self.step_count < step:
            phase = self.step_count % self._refresh_steps
            n = min(step - self.step_count, self._refresh_steps - phase)
            mujoco.mj_step(self.model, self.data, n)
            self.step_count += n
            self._stability.check(self.t)
            if self.step_count % self._refresh_steps == 0:
                self.refresh()

    def refresh(self) -> None:
        """Update shaft, tip force and wire friction from time and state, as every 10 ms."""
        course, t = self.course, self.t
        if course.turns:
            roll = rotation.about((1.0, 0.0, 0.0), course.shaft_roll_rad(t))
            self.data.mocap_quat[self._turning] = roll
        if course.pushes:
            force = scene.WORLD_FROM_BASE @ course.tip_force(t)
            self.data.xfrc_applied[self._tip, :3] = force
        self._wires.refresh(course.shaft_bend_rad(t), course.friction_times(t))
        self._current_at = self.step_count

    def board_position(self) -> tuple[float, float, float]:
        """Present position of the board's centre in the base frame [m]."""
        return (*self.course.board(self.t), self._distance_m + self.course.depth(self.t))

    def seen_speed(self) -> float:
        """Estimate the angular speed of the fastest object in the tip camera's picture [rad/s].

        Board, occluders and wall are considered, each with its middle and four points around it.
        """
        data, step = self.data, 1e-3
        velocity = np.empty(6)
        kind = mujoco.mjtObj.mjOBJ_CAMERA
        mujoco.mj_objectVelocity(self.model, data, kind, self._camera, velocity, 0)
        now, soon = (
            np.array([(*self.course.board(t), self._distance_m), *self.course.occluders(t)])
            for t in (self.t, self.t + step)
        )
        speeds = np.vstack([(soon - now) / step, np.zeros(3)]) @ scene.WORLD_FROM_BASE.T
        middles = np.vstack([now, (0.0, 0.0, self._distance_m + WALL_BEHIND_M)])
        around = self._distance_m / 2 * _CROSS
        points = self._origin + (middles[:, None] + around) @ scene.WORLD_FROM_BASE.T
        rays = points - data.cam_xpos[self._camera]
        moves = speeds[:, None] - velocity[3:] - np.cross(velocity[:3], rays)
        across = np.linalg.norm(np.cross(rays, moves), axis=-1)
        return float((across / np.einsum("...i,...i", rays, rays)).max())

    def draw_board(self) -> None:
        """Move board, occluders, cameras and lights to their current poses, for rendering."""
        positions = [self.board_position(), *self.course.occluders(self.t)]
        self.data.mocap_pos[self._moving] = self._origin + positions @ scene.WORLD_FROM_BASE.T
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def snapshot(self) -> Snapshot:
        """Copy the state from which the truth at this time is computed."""
        data = self.data
        self._update()
        return Snapshot(
            self.t,
            data.xmat[self._tip].copy(),
            data.xmat[self._base].copy(),
            data.xpos[self._backbone],
            self._wires.tensions(),
            self.board_position(),
        )

    def explain(self, moment: Snapshot) -> tuple[Plant, Vector]:
        """Compute the truth of a snapshot.

        Returns:
            The state of the plant, and the tip camera's orientation (3x3, base_from_camera).
        """
        tip, base = moment.tip.reshape(3, 3), moment.base.reshape(3, 3)
        backbone = self._with_camera(moment.backbone, tip)
        bend = rotation.to_vector(rotation.from_matrix(_in_camera_axes(base.T @ tip)))
        turn = self.instrument.misalignment_rad
        base_from_camera = _in_camera_axes(tip)
        if turn:
            base_from_camera = base_from_camera @ rotation.matrix_about_z(turn)
        plant = Plant(
            bend_rad=bend[:2],
            tip=_pose(moment.t, backbone[-1], base_from_camera),
            board=Pose(t=moment.t, position=moment.board, quaternion=self._tilt),
            backbone=backbone,
            tension_handle_n=tuple(moment.tensions[0]),
            tension_section_n=tuple(moment.tensions[1]),
        )
        return plant, base_from_camera

    def tip_pose(self) -> Pose:
        """Return the present pose of the tip as a rigid body, at the position of the camera.

        Its axes are those of the base frame when the section is straight, whatever the misalignment
        of the camera.
        """
        self._update()
        tip = self.data.xmat[self._tip].reshape(3, 3)
        position = self._with_camera(self.data.xpos[[self._tip]], tip)[-1]
        return _pose(self.t, position, _in_camera_axes(tip))

    def _update(self) -> None:
        if self._current_at != self.step_count:
            self._wires.update_lengths()
            self._current_at = self.step_count

    def _with_camera(self, backbone: Vector, tip: Vector) -> Vector:
        """Return points of the section up to the tip, and the camera, in the base frame [m]."""
        camera = backbone[-1] + self.instrument.rigid_tip_m * tip[:, 0]
        points: Vector = (np.vstack([backbone, camera]) - self._origin) @ scene.WORLD_FROM_BASE
        return points


def _compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a model.

    Raises:
        ConfigError: MuJoCo refuses it.
    """
    try:
        return spec.compile()
    except ValueError as error:
        said = " ".join(str(error).split())
        raise ConfigError(
            f"no model can be built from these values ({said})", "use values nearer to the defaults"
        ) from None


def _in_camera_axes(body: Vector) -> Vector:
    """Convert a rotation in axes (distal, left, up) to one in axes (right, down, distal)."""
    turned: Vector = scene.WORLD_FROM_BASE.T @ body @ scene.WORLD_FROM_BASE
    return turned


def _pose(t: float, position: Vector, orientation: Vector) -> Pose:
    x, y, z = position.tolist()
    return Pose(t=t, position=(x, y, z), quaternion=rotation.from_matrix(orientation))
