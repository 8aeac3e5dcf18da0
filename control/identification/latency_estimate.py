"""Latency of the video from handle motion against image motion, by cross-correlation.

While a handle turns one way all the time, the tip follows it without play, whatever the hysteresis:
where its speed is modulated, so is that of the picture, later by the latency L. With a_k the times
of delivery and h the handle, the rotation between two frames is

    r_k = g (h(a_k - L) - h(a_k-1 - L)) + noise,

and L is where the correlation of both sides is largest. Between exposures nothing is known of the
picture, and nothing needs to be: the handle's own history is fine enough. The a_k are taken from
the line through the times of delivery. Frames near a reversal of the handle are left out. Whole
strokes, drawn again with repetition, give the interval of 95 %.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from endolock.hw.api import Vector

LONGEST_S = 1.5
"""Longest latency that is looked for [s]."""
STEP_S = 0.005
LOST_RAD = 0.95
"""Handle travel after a reversal that is left out [rad]: the play of any instrument here."""
SLOW = np.arange(3)
"""Powers of time that are taken out of each stroke."""
DRAWS = 200


class Latency(NamedTuple):
    """What was found."""

    latency_s: float
    """Exposure to delivery, with whatever lag tip and handle have [s]."""
    ci95_s: tuple[float, float]
    """Interval of 95 % [s]."""
    jitter_s: float
    """Standard deviation of the times of delivery about an even rate [s]."""
    frame_rate_hz: float
    correlation: float
    """Of both motions at that latency [1]."""


class Strokes(NamedTuple):
    """Which handle motion is used: at each time the stroke's number, 0 where it is left out."""

    t: Vector
    handle: Vector
    stroke: Vector


def strokes(t: Vector, handle: Vector) -> Strokes:
    """Number the strokes of a handle that runs to and fro, less the play after each reversal.

    Args:
        t: times [s].
        handle: handle angles then [rad].
    """
    number, since, direction = 0, handle[0], 0.0
    numbers = np.zeros(len(t))
    extreme = handle[0]
    for n, angle in enumerate(handle):
        if direction == 0.0 or direction * (angle - extreme) < -0.01:
            if abs(angle - extreme) > 0.01:
                direction = 1.0 if angle > extreme else -1.0
                number, since, extreme = number + 1, extreme, angle
        elif direction * (angle - extreme) > 0:
            extreme = angle
        moved = direction * (angle - since) > LOST_RAD
        numbers[n] = number if direction and moved and angle == extreme else 0
    return Strokes(t, handle, numbers)


def measure(
    motion: Strokes, delivered: Vector, seq: Vector, rotation: Vector, draws: int = DRAWS
) -> Latency | str:
    """Find the latency.

    Args:
        motion: the handle.
        delivered: times of delivery of frames 0..n [s].
        seq: their numbers.
        rotation: rotation of the picture from each frame to the next, n numbers [rad]; NaN where
            unknown.
        draws: how many times strokes are drawn again for the interval.

    Returns:
        The result, or why there is none.
    """
    if not motion.stroke.any():
        return "the handle made no steady stroke; was it free to move?"
    taus = np.arange(-STEP_S, LONGEST_S + STEP_S / 2, STEP_S)  # 0 must not lie at the edge
    # Exposures are evenly spaced, whatever happens to the frames afterwards: jitter averages out.
    period, start = np.polyfit(seq, delivered, 1)
    even = period * seq + start
    early, late = even[:-1], even[1:]
    sums = []  # anew for each latency, for the stroke that a frame belongs to depends on it
    for tau in taus:
        turned = np.interp(late - tau, motion.t, motion.handle)
        turned -= np.interp(early - tau, motion.t, motion.handle)
        stroke = _stroke(motion, early - tau, late - tau)
        stroke[~np.isfinite(rotation)] = 0
        sums.append(_sums(turned, np.nan_to_num(rotation), stroke, int(motion.stroke.max())))
    table = np.array(sums)  # latency, stroke, sums
    if (table[..., 0].sum(axis=1) < 20).any():
        return "too few frames during steady strokes; record more strokes"
    best, peak = _peak(taus, table.sum(axis=1))
    if peak < 0.5:
        return f"picture and handle do not move together (correlation {peak:.2f})"
    random = np.random.default_rng(0)
    count = table.shape[1]
    drawn = [
        _peak(taus, table[:, random.integers(0, count, count)].sum(axis=1))[0] for _ in range(draws)
    ]
    low, high = np.percentile(drawn, [2.5, 97.5])
    jitter = float(np.std(delivered - even))
    return Latency(best, (float(low), float(high)), jitter, float(1 / period), peak)


def _stroke(motion: Strokes, early: Vector, late: Vector) -> Vector:
    """Stroke in which both times lie; 0 if in none."""
    places = [np.clip(np.searchsorted(motion.t, t), 0, len(motion.t) - 1) for t in (early, late)]
    first, last = (motion.stroke[place] for place in places)
    known = (early >= motion.t[0]) & (late <= motion.t[-1])
    number: Vector = np.where((first == last) & known, first, 0)
    return number


def _sums(x: Vector, y: Vector, stroke: Vector, count: int) -> Vector:
    """Number, and sums of x x, y y and x y, of each stroke, less their slow courses.

    Where the wires slip farther the same handle motion bends the tip more: that is no delay, and a
    parabola over each stroke takes it out.
    """
    rows = []
    for number in range(1, count + 1):
        inside = np.flatnonzero(stroke == number)
        if len(inside) < 2 * SLOW.size:
            rows.append(np.zeros(4))
            continue
        slow = np.linspace(-1.0, 1.0, len(inside))[:, None] ** SLOW
        pair = np.column_stack([x[inside], y[inside]])
        a, b = (pair - slow @ np.linalg.lstsq(slow, pair, rcond=None)[0]).T
        rows.append(np.array([len(inside), a @ a, b @ b, a @ b]))
    return np.array(rows)


def _peak(taus: Vector, sums: Vector) -> tuple[float, float]:
    """Latency of the largest correlation in size, between the steps by a parabola."""
    _, xx, yy, xy = sums.T
    r = np.abs(xy) / np.sqrt(np.maximum(xx * yy, 1e-60))
    k = int(np.clip(r.argmax(), 1, len(r) - 2))
    bend = r[k - 1] - 2 * r[k] + r[k + 1]
    shift = 0.5 * (r[k - 1] - r[k + 1]) / bend if bend < 0 else 0.0
    return float(taus[k] + shift * STEP_S), float(r[k])
