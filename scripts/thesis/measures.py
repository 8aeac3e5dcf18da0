"""Measures on the traces of runs, for the statements of the excerpt.

A measure over a part of a run in which the target was not seen is NaN, and no statement holds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from endolock.hw.api import Vector
from endolock.scripts.thesis.chapter_runs import LATENCY_S, STROKE_S, Trace

DISCONTINUITIES_S = (1, 6, 10, 15, 18)
"""T5: times at which the excerpt reports discontinuities."""
NEAR_S = 1.0
"""Tolerance for a time given in whole seconds [s]; our half period of 4.3 s is derived from the
times of T5, which have +- 0.5 s."""
FAST_S = 0.6
"""T8: maximum duration of a fast turn [s]. Assumed: servo and compensation take 0.3 s."""
UNMOVED_PX = 30.0
"""T8: a target that moved less has hardly moved [px]. Assumed: 7 % of the height of the plot."""


def largest(values: Vector) -> float:
    """Largest value; NaN for an empty array."""
    return float(np.max(values)) if values.size else float("nan")


def within(t: Vector, moment: float) -> NDArray[np.bool_]:
    """Return a mask of the times within `NEAR_S` of a moment [s]."""
    return np.asarray(np.abs(t - moment) <= NEAR_S)


def breaks(one: Trace) -> tuple[list[float], float]:
    """Largest discontinuity of x near each of `DISCONTINUITIES_S`, and anywhere else [px]."""
    size, t = np.abs(np.diff(one.error[:, 0], 2)), one.t[1:-1]
    near = [within(t, moment) for moment in DISCONTINUITIES_S]
    return [largest(size[part]) for part in near], largest(size[~np.any(near, axis=0)])


def peaks_by_way(strokes: Vector) -> tuple[float, float]:
    """Mean of a value per stroke over the ways out, without the first, and the ways back."""
    return float(strokes[2::2].mean()), float(strokes[1::2].mean())


def switches(one: Trace) -> Vector:
    """Times at which the target reverses, as seen with latency [s], without the start."""
    return np.arange(STROKE_S, one.t[-1] - 1.5, STROKE_S) + LATENCY_S


def after_switches(one: Trace) -> Vector:
    """Largest error within 1.5 s after each reversal [px]."""
    t, size = one.t, one.total
    return np.array([largest(size[(t > at) & (t < at + 1.5)]) for at in switches(one)])


def peak_delay(one: Trace) -> float:
    """Mean time from a reversal of the target to the peak error of the stroke [s].

    NaN if the error only falls after a reversal: the rest of the previous stroke is not a peak.
    """
    late = []
    for at in switches(one):
        part = (one.t >= at) & (one.t < at + STROKE_S)
        first = int(one.total[part].argmax()) if part.any() else 0
        late.append(float(one.t[part][first] - at) if first else float("nan"))
    return float(np.mean(late))


def fast_turn(one: Trace, start_s: float) -> float:
    """Largest travel of the left_right handle within `FAST_S`, the target hardly moving [deg]."""
    t, handle = one.handle_t, one.handle[:, 1]
    first = np.flatnonzero((t >= start_s) & (t + FAST_S + LATENCY_S <= one.t[-1]))
    ends = np.interp(t[first] + FAST_S, t, handle)
    seen = [
        np.interp(t[first] + LATENCY_S + more, one.t, one.error[:, 0]) for more in (0.0, FAST_S)
    ]
    unmoved = np.abs(seen[1] - seen[0]) < UNMOVED_PX
    return largest(np.abs(ends - handle[first])[unmoved])
