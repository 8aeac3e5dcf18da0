"""A log of handle angles and bends, and the rows of it that a fit uses.

The model starts with the wires at rest, but a log may start anywhere. Rows before the end of the
first long stroke are simulated but not fitted: such a stroke makes all wires slide, so the state
after it no longer depends on the start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from endolock.control.identification.cable_parameters import CableParameters
from endolock.control.transmission.quasi_static import Geometry
from endolock.control.transmission.simulation import simulate, thin
from endolock.hw.api import Vector

LONG_STROKE = 0.45
"""Travel after which all wires slide, as a fraction of the handle's range: from the middle to a
crest."""


@dataclass(frozen=True)
class HandleLog:
    """Recorded handle angles, bends and tensions, at common times.

    Args:
        t: times [s], m.
        handle: handle angles (up_down, left_right) [rad], m x 2.
        bend: bends (up_down, left_right) [rad], m x 2.
        tension: tensions of the wires up, right, down, left at the handle [N], m x 4, or None.
    """

    t: Vector
    handle: Vector
    bend: Vector
    tension: Vector | None = None

    @property
    def axis(self) -> int:
        """The axis that was moved, the one with the larger range of handle angles."""
        return int(np.ptp(self.handle, axis=0).argmax())

    @property
    def noise_rad(self) -> float:
        """Noise of single bends, from second differences [rad]; the median ignores reversals."""
        return float(1.4826 * np.median(np.abs(np.diff(self.bend[:, self.axis], 2))) / np.sqrt(6))


@dataclass(frozen=True, kw_only=True)
class LogRows:
    """Rows kept of a log, after a simulated path from rest to where the log starts."""

    handle: Vector
    """Handle angles of the axis that was moved [rad]."""
    bend: Vector
    """Its bends [rad]."""
    other_handle: Vector
    """Handle angles of the other axis [rad]."""
    other_bend: Vector
    """Bends of the other axis [rad]."""
    tension: Vector | None
    """Tensions at the handle of the wire pulled by a positive angle and of the opposite one [N]."""
    settled: int
    """First row that is fitted."""
    learned: int
    """First row that is predicted instead."""
    samples: int
    """Number of measured rows."""

    def predict(
        self, parameters: CableParameters, geometry: Geometry, end: int | None = None
    ) -> tuple[Vector, Vector]:
        """Simulate the first rows.

        Args:
            parameters: the cable, and the zeros of handle and tip.
            geometry: of the section.
            end: number m of rows; all if None.

        Returns:
            Bends, m [rad], and tensions at the handle over K, m x 2 [1/m].
        """
        bends, tensions = simulate(
            parameters.cable,
            geometry,
            self.handle[:end] - parameters.handle_zero_rad,
            self.other_handle[:end],
            self.other_bend[:end],
        )
        return bends + parameters.tip_zero_rad, tensions


def rows_of(log: HandleLog, step_rad: float) -> LogRows:
    """Select the rows of a log that a fit uses.

    Args:
        log: the whole log.
        step_rad: handle travel between two rows [rad].
    """
    axis, other = log.axis, 1 - log.axis
    kept = thin(log.handle[:, axis], step_rad)
    start = float(log.handle[kept[0], axis])
    lead = np.arange(0.0, abs(start), step_rad) * np.sign(start)  # from rest to the first angle
    settled = len(lead) + _first_long_stroke(log.handle[kept, axis])
    kept = [kept[0]] * len(lead) + kept
    learned = int(np.searchsorted(log.t[kept], log.t[0] + 2 / 3 * np.ptp(log.t)))
    handle = log.handle[kept, axis]
    handle[: len(lead)] = lead
    return LogRows(
        handle=handle,
        bend=log.bend[kept, axis],
        other_handle=log.handle[kept, other],
        other_bend=log.bend[kept, other],
        tension=None if log.tension is None else log.tension[kept][:, [axis, axis + 2]],
        # if there is no long stroke early on, the strokes grew slowly and began at rest
        settled=settled if settled < learned / 2 else len(lead),
        learned=learned,
        samples=len(kept) - len(lead),
    )


def _first_long_stroke(handle: Vector) -> int:
    """Return the row where the handle has travelled `LONG_STROKE` of its range in one direction."""
    up = handle - np.minimum.accumulate(handle)
    down = np.maximum.accumulate(handle) - handle
    return int(np.argmax(np.maximum(up, down) >= LONG_STROKE * np.ptp(handle)))
