"""The course of a run: where board, shaft and occluders are and what pushes the tip at any time."""

from __future__ import annotations

from math import pi, radians, sin

from endolock.hw.api import Vector
from endolock.twin.randomness import generator
from endolock.twin.world import mid_run
from endolock.twin.world.motion import Offset, Random
from endolock.twin.world.scenario import Scenario
from endolock.twin.world.scenario_sections import Shaft

Point = tuple[float, float, float]
"""Position [m] or force [N] (right, down, distal) in the base frame."""


class Course:
    """State of the surroundings at any time t >= 0, in any order; queries have no side effects.

    Args:
        scenario: its motions, shaft changes, pushes, occluders and changes of friction are used.
        seed: seed of the random motions, >= 0.
    """

    def __init__(self, scenario: Scenario, seed: int) -> None:
        random = [motion for motion in scenario.motion if isinstance(motion, Random)]
        self._moves = [m.offset for m in scenario.motion if not isinstance(m, Random)]
        for n, motion in enumerate(random):
            source = f"board.random.{n}" if n else "board.random"
            self._moves.append(motion.path(generator(seed, source)).offset)
        self._board = scenario.board
        self._bend_rad = radians(scenario.shaft_bend_deg)
        self._bends = [e for e in scenario.shaft if e.kind == "bend"]
        self._rolls = [e for e in scenario.shaft if e.kind == "roll"]
        self._pushes = scenario.push
        self._occluders = scenario.occluder
        self.turns = bool(self._rolls)
        """Whether the shaft ever rolls."""
        self.pushes = bool(self._pushes)
        """Whether the tip is ever pushed."""
        self._changes = mid_run.in_order(scenario.change)
        self.rubs = any(change.friction_times is not None for change in self._changes)
        """Whether the friction of the wires ever changes."""

    def board(self, t: float) -> Offset:
        """Displacement of the board (right, down) [m]."""
        moves = [move(t) for move in self._moves]
        return sum((m[0] for m in moves), 0.0), sum((m[1] for m in moves), 0.0)

    def depth(self, t: float) -> float:
        """Displacement of the board away from the tip [m]."""
        travel, period = self._board.depth_travel_m, self._board.depth_period_s
        return travel / 2 * sin(2 * pi * t / period) if travel else 0.0

    def shaft_bend_rad(self, t: float) -> float:
        """Bend of the shaft, all in one plane [rad]."""
        return self._bend_rad + _sum(self._bends, t) if self._bends else self._bend_rad

    def shaft_roll_rad(self, t: float) -> float:
        """Rotation of the section's base about +z of the base frame, which points distally [rad].

        A positive angle turns x, right, towards y, down: the camera turns clockwise, a still scene
        appears to turn counter-clockwise.
        """
        return _sum(self._rolls, t) if self._rolls else 0.0

    def tip_force(self, t: float) -> Point:
        """Sum of the pushes on the tip [N]."""
        forces = [push.force(t) for push in self._pushes]
        return sum((f[0] for f in forces), 0.0), sum((f[1] for f in forces), 0.0), 0.0

    def friction_times(self, t: float) -> float:
        """Friction of the wires over that at the start [1]."""
        return mid_run.value_at(self._changes, "friction_times", 1.0, t) if self.rubs else 1.0

    def occluders(self, t: float) -> tuple[Point, ...]:
        """Positions of the centres of the occluders [m]."""
        return tuple(occluder.position(t) for occluder in self._occluders)

    def hides(self, t: float, eye: Point, target: Vector) -> bool:
        """Whether an occluder hides a target from an eye; both are points in the base frame [m]."""
        for occluder in self._occluders:
            x, y, z = occluder.position(t)
            ahead = float(target[2]) - eye[2]
            part = (z - eye[2]) / ahead if ahead > 0 else 0.0
            if 0 < part < 1:
                off_x = eye[0] + part * (float(target[0]) - eye[0]) - x
                off_y = eye[1] + part * (float(target[1]) - eye[1]) - y
                width, height = occluder.size_m
                if abs(off_x) <= width / 2 and abs(off_y) <= height / 2:
                    return True
        return False


def _sum(changes: list[Shaft], t: float) -> float:
    return sum(radians(change.by_deg) * change.done(t) for change in changes)
