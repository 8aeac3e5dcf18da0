"""Figures of recorded strokes: widths of the loop, lost motion, deadband.

Widths and lost motion are fractions of 180 deg of handle angle.
"""

from __future__ import annotations

from math import degrees, pi, radians
from typing import Any

from endolock.control.identification.hysteresis_loop import (
    Branch,
    deadband,
    lost_after_turn,
    width,
)
from endolock.scripts.runs.hysteresis_protocol import TURNS_DEG, RecordedStrokes

BENDS_DEG = (0, 30, 60, 90)
"""Bends at which widths are reported."""
LOOP_POINTS = 400
"""Number of points of the loop in the record, about."""


def figures(strokes: RecordedStrokes) -> dict[str, Any]:
    """Return the figures of recorded strokes by name, a part of the record of a measurement."""
    falling, rising = strokes.loop
    handle = [*falling.handle, *rising.handle]
    bend = [*falling.bend, *rising.bend]
    every = max(1, len(handle) // LOOP_POINTS)
    points = list(zip(handle, bend, strict=True))[::every]
    one_sided = {}
    for side, turns in strokes.one_sided.items():
        pairs = {str(turn): turns.get(turn) for turn in sorted(TURNS_DEG)}
        one_sided[side] = {
            "out": {turn: _lost(pair[0]) if pair else None for turn, pair in pairs.items()},
            "back": {turn: _lost(pair[1]) if pair else None for turn, pair in pairs.items()},
        }
    return {
        "width": {str(d): width_at(strokes, d) for d in BENDS_DEG},
        "strokes": one_sided,
        "deadband_rad": deadband_of(strokes),
        "max_bend_deg": degrees(max(bend)),
        "drift_deg_per_min": strokes.drift_deg_per_min,
        "crest_rad": strokes.reached_rad,
        "loop": [[round(float(h), 6), round(float(b), 6)] for h, b in points],
    }


def width_at(strokes: RecordedStrokes, bend_deg: float) -> float | None:
    """Return the width of the loop at a bend, mean of both sides; None if one was not passed."""
    sides = [_fraction(*strokes.loop, sign * bend_deg) for sign in (1, -1)]
    found = [side for side in sides if side is not None]
    return sum(found) / 2 if len(found) == 2 else None


def deadband_of(strokes: RecordedStrokes) -> float:
    """Return the deadband of the loop, mean of both branches [rad]."""
    falling, rising = strokes.loop
    return (deadband(falling) + deadband(rising)) / 2


def _fraction(falling: Branch, rising: Branch, bend_deg: float) -> float | None:
    lost = width(falling, rising, radians(bend_deg))
    return None if lost is None else lost / pi


def _lost(branch: Branch) -> float | None:
    lost = lost_after_turn(branch)
    return None if lost is None else lost / pi
