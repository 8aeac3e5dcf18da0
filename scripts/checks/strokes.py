"""Slow strokes of a plant without a rig, for the checks."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, radians

import mujoco
import numpy as np

from endolock.hw.api import AXES, Vector
from endolock.twin.physics.plant import TwinPlant
from endolock.twin.world import scenario
from endolock.twin.world.instrument import Instrument, Numerics

ONE_WIRE = Instrument(slack_m=0.0)
"""Wires neither slack nor under pretension: only the pulled wire carries a load."""
SHAFTS_DEG = (0.0, 180.0, 360.0)
SEED = 7
"""Seed of the random hinge angles and handle motions; arbitrary."""


@dataclass(frozen=True)
class HandleMotion:
    """A slow motion of one handle while the other one is held."""

    t: Vector
    handle: Vector
    bend: Vector
    """Bend of the same axis [rad]."""
    proximal: Vector
    """Tension at the handle of the wire that a positive angle pulls [N]."""
    distal: Vector
    """Tension of the same wire at the section [N]."""
    opposite: Vector
    """Tension at the handle of the other wire of the axis [N]."""

    def between(self, start: float, end: float) -> HandleMotion:
        """Return the rows of a time span [s]."""
        kept = (self.t >= start) & (self.t <= end)
        return HandleMotion(*(column[kept] for column in vars(self).values()))


def still(
    instrument: Instrument | None = None,
    numerics: Numerics | None = None,
    *,
    shaft_deg: float = 180.0,
    gravity: bool = False,
) -> TwinPlant:
    """Create a plant at rest with its motors on."""
    rest = scenario.load("rest", {"shaft_bend_deg": shaft_deg, "gravity": gravity})
    return TwinPlant(rest, instrument or Instrument(), numerics or Numerics(), 0)


def turn(plant: TwinPlant, corners: list[tuple[float, float]], axis: int = 0) -> HandleMotion:
    """Turn a handle along straight lines.

    Args:
        plant: its motion starts from its present state.
        corners: (time from now [s], angle [rad]), in order.
        axis: 0 up_down, 1 left_right.
    """
    model, data = plant.model, plant.data
    handle = int(model.joint(f"handle_{AXES[axis]}").qposadr[0])
    bends = hinges(model, axis)
    start, step = plant.t, round(0.010 / plant.timestep_s)
    times, angles = zip(*corners, strict=True)
    rows = []
    while plant.t < start + times[-1] - 1e-9:
        data.ctrl[axis] = np.interp(plant.t - start, times, angles)
        plant.advance(plant.step_count + step)
        proximal, distal = plant.snapshot().tensions
        bend = data.qpos[bends].sum()
        wires = proximal[axis], distal[axis], proximal[axis + 2]
        rows.append((plant.t - start, data.qpos[handle], bend, *wires))
    return HandleMotion(*np.array(rows).T)


def loop(plant: TwinPlant, peak: float, period_s: float, axis: int = 0) -> HandleMotion:
    """Turn a handle in a triangle wave; return the second of two periods, from crest to crest."""
    quarter = period_s / 4
    corners = [(quarter * (2 * n + 1), peak * (-1) ** n) for n in range(5)]
    return turn(plant, [(0.0, 0.0), *corners], axis).between(5 * quarter, 9 * quarter)


def width(motion: HandleMotion, bend_deg: float) -> float:
    """Width of a loop from crest to crest at a bend, as a fraction of 180 deg of handle angle."""
    trough = int(motion.handle.argmin())
    falling = np.interp(radians(-bend_deg), -motion.bend[:trough], motion.handle[:trough])
    rising = np.interp(radians(bend_deg), motion.bend[trough:], motion.handle[trough:])
    return float(rising - falling) / pi


def hinges(model: mujoco.MjModel, axis: int) -> list[int]:
    """Find the hinge angles of an axis (0 up_down, 1 left_right) in qpos, from base to tip."""
    joints = (model.joint(i) for i in range(model.njnt))
    return [int(j.qposadr[0]) for j in joints if j.name.startswith(f"hinge_{AXES[axis]}")]
