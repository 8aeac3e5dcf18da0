"""The plant of a surrogate: servos, a transmission without time, a section without inertia.

The handles follow their goals with a first-order lag; the transmission turns handle angles into
bends; a bend gives the tip's pose by constant curvature.
"""

from __future__ import annotations

from math import exp
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np

from endolock.control.transmission import kinematics
from endolock.control.transmission.kinematics import Pair
from endolock.hw import rotation
from endolock.hw.api import ConfigError, Plant, Pose, Vector
from endolock.hw.frozen import read_only
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.instrument_cable import section_of
from endolock.twin.world.joint_conditions import check_shaft
from endolock.twin.world.playback import Course
from endolock.twin.world.scenario import Scenario

TIMESTEP_S = 0.01
SERVO_LAG_S = 0.025
"""Time constant of a handle behind its goal [s]. Source: measured on the twin's servo."""
NO_TENSION = (0.0,) * 4
"""A surrogate has no wires."""


class Follower(Protocol):
    """Both axes with their history."""

    def follow(self, handles: Pair) -> Pair:
        """Turn the handles to these angles [rad]; return the bends [rad]."""


@runtime_checkable
class Rubbing(Follower, Protocol):
    """Both axes, with friction that can change."""

    def rub(self, times: float) -> None:
        """Set the friction to a multiple of that at rest [1]."""


class Transmission(Protocol):
    """From handle angles to bends: a dataclass of plain values."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def at_rest(self) -> Follower:
        """Return both axes in their state before the handles turn."""


def bend_of(transmission: Transmission, handle_rad: Vector) -> Vector:
    """Return the bends of the first axis for handle angles from rest on, the other axis at zero.

    Args:
        transmission: from handle angles to bends.
        handle_rad: handle angles, n [rad].
    """
    axes = transmission.at_rest()
    return np.array([axes.follow((handle, 0.0))[0] for handle in handle_rad.tolist()])


class Moment(NamedTuple):
    """State from which the truth is computed."""

    t: float
    bend: Pair
    board: tuple[float, float, float]


class SurrogatePlant:
    """Servos, transmission and section.

    Args:
        scenario: motion of the board.
        transmission: from handle angles to bends.
        instrument: its lengths are used.
        seed: seed of the random motions.

    Raises:
        ConfigError: a wire would break, or not move, with the shaft bent like this, or the scenario
            changes a friction that the transmission does not have.
    """

    def __init__(
        self, scenario: Scenario, transmission: Transmission, instrument: Instrument, seed: int
    ) -> None:
        check_shaft(scenario, instrument)
        self.course = Course(scenario, seed)
        self._tilt = scenario.board.quaternion
        self.base_from_board = read_only(rotation.to_matrix(self._tilt))
        self._distance_m = scenario.board.distance_m
        self._geometry = section_of(instrument)
        self._axes = transmission.at_rest()
        self._friction_times = 1.0
        if self.course.rubs and not isinstance(self._axes, Rubbing):
            raise ConfigError(
                f"scenario {scenario.name} changes the friction, and this transmission has none",
                "leave friction_times out, or use --rig twin",
            )
        self._keep = exp(-TIMESTEP_S / SERVO_LAG_S)
        self.goal = self.handles = self.speed = self.bend = (0.0, 0.0)
        self.step_count = 0

    @property
    def t(self) -> float:
        """Present time [s]."""
        return self.step_count * TIMESTEP_S

    def advance(self, step: int) -> None:
        """Advance to a grid point with constant goals."""
        keep, axes = self._keep, self._axes
        while self.step_count < step:
            (a, b), (goal_a, goal_b) = self.handles, self.goal
            off_a, off_b = keep * (a - goal_a), keep * (b - goal_b)
            self.handles = goal_a + off_a, goal_b + off_b
            self.speed = -off_a / SERVO_LAG_S, -off_b / SERVO_LAG_S
            if self.course.rubs:
                self._rub(self.course.friction_times(self.t))
            self.bend = axes.follow(self.handles)
            self.step_count += 1

    def _rub(self, times: float) -> None:
        if times != self._friction_times and isinstance(self._axes, Rubbing):
            self._friction_times = times
            self._axes.rub(times)

    def snapshot(self) -> Moment:
        """Copy the state from which the truth at this time is computed."""
        t = self.t
        board = *self.course.board(t), self._distance_m + self.course.depth(t)
        return Moment(t, self.bend, board)

    def explain(self, moment: Moment) -> tuple[Plant, Vector]:
        """Compute the truth of a moment: state of the plant, and orientation of the camera."""
        position, base_from_camera = kinematics.forward(self._geometry, moment.bend)
        x, y, z = position.tolist()
        bent = rotation.from_vector((*moment.bend, 0.0))
        turn = rotation.about((0.0, 0.0, 1.0), self._geometry.misalignment_rad)
        plant = Plant(
            bend_rad=moment.bend,
            tip=Pose(t=moment.t, position=(x, y, z), quaternion=rotation.product(bent, turn)),
            board=Pose(t=moment.t, position=moment.board, quaternion=self._tilt),
            backbone=position[None],
            tension_handle_n=NO_TENSION,
            tension_section_n=NO_TENSION,
        )
        return plant, base_from_camera
