"""Plays that come nearest to the transmission of an instrument, for rigs and controllers."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from math import radians

import numpy as np

from endolock.control.transmission import plays
from endolock.control.transmission.plays import Plays
from endolock.control.transmission.simulation import simulate
from endolock.hw.api import Vector
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.instrument_cable import transmission_of

RADII = tuple(float(r) for r in np.linspace(0.0, 0.6, 25))
"""Half-widths of the fitted plays [rad]."""


@lru_cache(maxsize=64)
def plays_of(instrument: Instrument, shaft_deg: float, radii: tuple[float, ...] = RADII) -> Plays:
    """Fit plays to one axis of an instrument, as the quasi-static solver has it.

    Args:
        instrument: parameters of the endoscope.
        shaft_deg: bend of its shaft [deg].
        radii: half-widths of the plays, whose weights are fitted [rad].
    """
    handle = exercise()
    still = np.zeros(len(handle))
    wires = transmission_of(instrument, radians(shaft_deg))
    bend, _ = simulate(wires.cable, wires.geometry, handle, still, still)
    return plays.fit(handle, bend, radii)[0]


def exercise(largest_rad: float = 1.4, step_rad: float = 0.02) -> Vector:
    """Return handle angles: strokes of all sizes in both directions, from rest [rad]."""
    turns = [0.0]
    for share in (1.0, 0.6, 0.3, 0.1):
        turns += [share * largest_rad, -share * largest_rad, share * largest_rad, 0.0]
    parts = [
        np.linspace(a, b, max(2, round(abs(b - a) / step_rad)), endpoint=False)
        for a, b in pairwise(turns)
    ]
    return np.concatenate(parts)
