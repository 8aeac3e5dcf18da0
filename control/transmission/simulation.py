"""Quasi-static response of one axis to a history of handle angles, and the samples it needs."""

from __future__ import annotations

import numpy as np

from endolock.control.transmission.quasi_static import Axis, Cable, Geometry
from endolock.hw.api import Vector


def thin(handle: Vector, step_rad: float) -> list[int]:
    """Select samples one step of handle travel apart, and those where the handle reverses.

    Args:
        handle: handle angles [rad], m.
        step_rad: travel between two samples [rad]; reversals below a quarter of it are noise.
    """
    kept, farthest = [0], 0
    for k, angle in enumerate(handle.tolist()):
        last, far = handle[kept[-1]], handle[farthest]
        if abs(angle - far) >= step_rad / 4 and (angle - far) * (far - last) < 0:
            kept.append(farthest)
            last, farthest = far, k
        if abs(angle - last) >= step_rad:
            kept.append(k)
            farthest = k
        elif abs(angle - last) >= abs(handle[farthest] - last):
            farthest = k
    return kept


def simulate(
    cable: Cable,
    geometry: Geometry,
    handle_rad: Vector,
    other_handle_rad: Vector,
    other_bend_rad: Vector,
) -> tuple[Vector, Vector]:
    """Simulate a history of handle angles from rest.

    Args:
        cable: the transmission.
        geometry: the section.
        handle_rad: handle angles [rad], m.
        other_handle_rad: handle angles of the other axis at the same times [rad], m.
        other_bend_rad: bends of the other axis [rad], m.

    Returns:
        Bends [rad], m, and tensions at the handle over K [1/m], m x 2.
    """
    axis = Axis(cable, geometry)
    bends, tensions = [], []
    inputs = (column.tolist() for column in (handle_rad, other_handle_rad, other_bend_rad))
    for handle, other_handle, other_bend in zip(*inputs, strict=True):
        bends.append(axis.follow(handle, other_handle, other_bend))
        tensions.append(axis.tensions)
    return np.array(bends), np.array(tensions)
