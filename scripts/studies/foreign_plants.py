"""Plants with hysteresis of another kind, by which identification must not be fooled.

Fitting a log that one's own model has made tells how well a fit can be done, not that the model is
right. These two know no wires. Their numbers are arbitrary: about 0.2 of 180 deg wide, about as
much bend per handle as the twin.

Reference:
    Y. K. Wen, J. Engineering Mechanics 102(2), 1976; P. Krejci and K. Kuhnen, IEE Proc. Control
    Theory and Applications 148(3), 2001.
"""

from __future__ import annotations

import numpy as np

from endolock.hw.api import Vector


def bouc_wen(handle: Vector) -> Vector:
    """Bend behind a Bouc-Wen element, z' = phi' (1 - |z| (4 sign(phi' z) + 1)).

    Args:
        handle: handle angles in small steps [rad], m.
    """
    z, lost = 0.0, []
    for step in np.diff(handle, prepend=handle[0]) / 10:
        for _ in range(10):
            z += step * (1.0 - abs(z) * (4.0 * np.sign(step * z) + 1.0))
        lost.append(z)
    return 0.7 * (handle - 1.3 * np.array(lost))


def prandtl_ishlinskii(handle: Vector) -> Vector:
    """Bend behind a weighted sum of plays.

    Args:
        handle: handle angles [rad], m.
    """
    total = 0.25 * handle
    for width, weight in ((0.2, 0.15), (0.5, 0.2), (0.9, 0.1)):
        at, taken = 0.0, []
        for angle in handle:
            at = min(max(at, angle - width / 2), angle + width / 2)
            taken.append(at)
        total = total + weight * np.array(taken)
    return np.asarray(total)
