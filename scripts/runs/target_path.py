"""Path of the target: the tip motion that it needs, and the error of the best constant bend.

A controller has gained nothing by moving the handles unless its error is below that of the constant
bend that would have been best in hindsight. A controller that follows moves the tip about as far as
the path needs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from endolock.control import metrics
from endolock.control.rms import rms
from endolock.control.scores import ErrorSummary
from endolock.control.transmission import kinematics
from endolock.control.transmission.kinematics import Pair, SectionGeometry
from endolock.hw import boards
from endolock.hw.api import Calibration, Vector
from endolock.hw.rotation import matrix_about_z, to_matrix
from endolock.twin.camera import optics
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.instrument_cable import section_of
from endolock.twin.world.playback import Course
from endolock.twin.world.scenario import Scenario
from endolock.vision import camera_model

STEP_S = 0.1
"""Sampling interval of the path [s]: about a tenth of the shortest period, a heartbeat at
1.2 Hz."""
COARSE_RAD = 0.1
"""Spacing of the grid on which the search for the best bend starts [rad]."""


class Hindsight(NamedTuple):
    """Bounds that follow from a path known in advance."""

    needed_tip_deg: Pair
    """Peak-to-peak bend of a tip that always points at the target (up_down, left_right) [deg]."""
    constant_px: ErrorSummary | None
    """Error of the best constant bend [px]; None where the tip is pushed, so that a constant handle
    angle does not keep it still."""


def hindsight(scenario: Scenario, instrument: Instrument, seed: int) -> Hindsight:
    """Compute both bounds over the scored part of the path.

    The section has constant curvature and its base is at rest.

    Args:
        scenario: how the board moves.
        instrument: gives the lengths of the section.
        seed: seed of the random motions of the scenario.
    """
    geometry = section_of(instrument)
    path = sample_path(scenario, seed)
    bends = np.array([kinematics.aim(geometry, point) for point in path])
    up_down, left_right = np.degrees(np.ptp(bends, axis=0)).tolist()
    needed = up_down, left_right
    if scenario.push:
        return Hindsight(needed, None)
    error = _best_constant(geometry, optics.calibration(scenario.camera), path, bends)
    return Hindsight(needed, metrics.summary(error))


def sample_path(scenario: Scenario, seed: int) -> Vector:
    """Sample the scored part of the target's path in the frame of the section's base, n x 3 [m]."""
    course = Course(scenario, seed)
    board = scenario.board
    target = boards.aimed(board.kind, board.target).target
    turn = to_matrix(board.quaternion)
    on_board = turn @ np.array([*target, 0.0])
    points = []
    for t in np.arange(scenario.scored_from_s, scenario.duration_s + STEP_S / 2, STEP_S).tolist():
        right, down = course.board(t)
        point = np.array([right, down, board.distance_m + course.depth(t)]) + on_board
        points.append(matrix_about_z(-course.shaft_roll_rad(t)) @ point)
    return np.array(points)


def _best_constant(
    geometry: SectionGeometry, camera: Calibration, path: Vector, bends: Vector
) -> Vector:
    """Return the errors of the bend with the smallest rms error [px]; `bends` point at the path."""
    from scipy.optimize import minimize  # half a second to load

    def errors(bend: Vector) -> Vector:
        position, rotation = kinematics.forward(geometry, (float(bend[0]), float(bend[1])))
        points = (path - position) @ rotation
        ahead = points[:, 2] > 0
        distance = np.full(len(path), metrics.BEHIND_PX)
        if ahead.any():
            pixels = camera_model.project_points(camera, points[ahead])
            distance[ahead] = np.hypot(*(pixels - camera.centre_px).T)
        error: Vector = np.minimum(distance, metrics.BEHIND_PX)
        return error

    def error_rms(bend: Vector) -> float:
        return rms(errors(bend))

    low, high = bends.min(axis=0), bends.max(axis=0)
    axes = [np.arange(a, b + COARSE_RAD, COARSE_RAD) for a, b in zip(low, high, strict=True)]
    starts = [np.array([a, b]) for a in axes[0] for b in axes[1]]
    start = min(starts, key=error_rms)
    best = minimize(error_rms, start, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-2})
    return errors(best.x)
