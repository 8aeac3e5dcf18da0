"""From desired bends to goals of the handles: the inverse of the model, at a limited speed.

A handle that is to turn back has to cross its loop first, which takes a while. Where a turn of the
target is foreseen, the way through the loop starts early, so that a part of it is left when it
comes. A bend that is slightly beyond the desired one does not turn a handle back.
"""

from __future__ import annotations

from math import pi

from endolock.control.predictive.model_in_use import ModelInUse
from endolock.control.predictive.reference_play import ReferencePlay
from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Vector

SPEED_RAD_S, HURRY = 1.9, 2.0
"""Speed at which the handles cross their loops [rad/s], and factor on it while the tip is more than
`HURRY_RAD` off. Assumed: half of what the servos of the thesis can do."""
HURRY_RAD = 0.15
"""Distance from the desired bend above which the handles hurry [rad]."""
SLACK_RAD, SLACK_SHARE = 0.004, 0.5
"""Distance of the bend beyond the desired one that does not turn a handle back [rad], and the same
in reaches of the reference play [1]. Assumed: 1.5 px at 12 cm."""
UNSURE_RAD = 0.012
"""Expected error of the prediction above which the speed rises in proportion [rad]: turns are not
foreseen then."""
EARLY = 0.35
"""Part of a loop that is left to cross when a foreseen turn comes [1]. Source: tuned on strokes."""
LONGEST_S = 0.35
"""Longest time that a turn is foreseen [s]."""


def foreseen_s(widths: Vector) -> Pair:
    """Time that each handle needs to cross its loop, 2 [s].

    Args:
        widths: widths of the loops, 2 [rad].
    """
    first, second = widths.tolist()
    return min(first / SPEED_RAD_S, LONGEST_S), min(second / SPEED_RAD_S, LONGEST_S)


def next_goals(
    goals: Pair,
    model: ModelInUse,
    plays: tuple[ReferencePlay, ReferencePlay],
    wanted: Pair,
    soon: Pair,
    *,
    speeds: Pair,
    dt: float,
) -> Pair:
    """Goals of the handles for the next tick [rad].

    Args:
        goals: their goals so far [rad].
        model: model of the transmission.
        plays: reference plays, which have the directions of motion.
        wanted: bends that the model is to have, 2 [rad].
        soon: the same after the time that a handle needs for its loop, 2 [rad].
        speeds: highest speeds [rad/s].
        dt: length of the tick [s].
    """
    early, present = foreseen_s(model.likely_widths), model.bend.tolist()
    now = model.handles_for(wanted, pi)
    facing = plays[0].direction, plays[1].direction
    turns = any(
        (later - at) * way < 0 for later, at, way in zip(soon, present, facing, strict=True)
    )
    then = model.handles_for(soon, pi) if turns else now
    new = []
    for axis, play in enumerate(plays):
        old, goal, ahead = goals[axis], now[axis], then[axis]
        handle, way = float(model.history.handles[axis]), facing[axis]
        beyond = abs(wanted[axis] - present[axis])
        if (ahead - handle) * way < 0 <= (goal - handle) * way:  # a turn is foreseen
            left = EARLY * SPEED_RAD_S * early[axis]
            goal = min(max(goal, ahead - left), ahead + left)
        elif (goal - old) * way <= 0 and beyond < max(SLACK_RAD, SLACK_SHARE * play.reach_rad):
            goal = old  # not worth the way back through the loop
        step = speeds[axis] * dt
        new.append(min(max(goal, old - step, -pi), old + step, pi))
    return new[0], new[1]


def speed(distance: float, expected: float) -> float:
    """Speed of a handle [rad/s].

    Args:
        distance: of the bend from the desired one [rad].
        expected: expected error of the prediction [rad].
    """
    hurry = HURRY if abs(distance) > HURRY_RAD else 1.0
    return SPEED_RAD_S * max(hurry, expected / UNSURE_RAD)
