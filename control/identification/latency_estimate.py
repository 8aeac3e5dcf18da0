"""Latency of the video, by cross-correlation of handle motion and image motion.

While a handle moves in one direction, the tip follows it without play for any hysteresis: a
modulation of its speed appears in the picture after the latency L. With a_k the delivery times and
h the handle angle, the rotation between two frames is

    r_k = g (h(a_k - L) - h(a_k-1 - L)) + noise,

and L maximises the correlation of both sides. The picture is known only at the exposures, which is
enough because the history of the handle is fine. The a_k are from a line fitted to the delivery
times. Frames near a reversal of the handle are left out. The 95 % interval is from bootstrap
samples of whole strokes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from endolock.hw.api import Vector

LONGEST_S = 1.5
"""Longest latency that is searched for [s]."""
STEP_S = 0.005
"""Step of the search [s]."""
LOST_RAD = 0.95
"""Handle travel after a reversal that is left out [rad]: the play of all instruments here."""
SLOW = np.arange(3)
"""Powers of time that are removed from each stroke."""
DRAWS = 200
"""Number of bootstrap samples."""


class Latency(NamedTuple):
    """Result of the estimate."""

    latency_s: float
    """From exposure to delivery, including the lag of tip and handle [s]."""
    ci95_s: tuple[float, float]
    """95 % confidence interval [s]."""
    jitter_s: float
    """Standard deviation of the delivery times from a constant rate [s]."""
    frame_rate_hz: float
    """Mean frame rate [Hz]."""
    correlation: float
    """Correlation of both motions at that latency [1]."""


class HandleStrokes(NamedTuple):
    """Handle motion, divided into strokes."""

    t: Vector
    """Times, m [s]."""
    handle: Vector
    """Handle angles, m [rad]."""
    stroke: Vector
    """Number of the stroke, m; 0 where the motion is left out."""


def strokes(t: Vector, handle: Vector) -> HandleStrokes:
    """Divide back-and-forth motion of a handle into strokes, without the play after reversals.

    Args:
        t: times [s].
        handle: handle angles at these times [rad].
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
    return HandleStrokes(t, handle, numbers)


def measure(
    motion: HandleStrokes, delivered: Vector, seq: Vector, rotation: Vector, draws: int = DRAWS
) -> Latency | str:
    """Estimate the latency.

    Args:
        motion: motion of the handle.
        delivered: delivery times of frames 0..n [s].
        seq: sequence numbers of the frames.
        rotation: rotation of the picture from each frame to the next, n [rad]; NaN where unknown.
        draws: number of bootstrap samples.

    Returns:
        The result, or the reason why there is none.
    """
    if not motion.stroke.any():
        return "the handle made no steady stroke; was it free to move?"
    taus = np.arange(-STEP_S, LONGEST_S + STEP_S / 2, STEP_S)  # 0 must not lie at the edge
    # Exposures are evenly spaced, so jitter of the delivery averages out.
    period, start = np.polyfit(seq, delivered, 1)
    even = period * seq + start
    early, late = even[:-1], even[1:]
    sums = []  # for each latency, because the stroke of a frame depends on it
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
        what = f"picture and handle do not move together (correlation {peak:.2f})"
        return f"{what}; point the camera at a still object with texture"
    random = np.random.default_rng(0)
    count = table.shape[1]
    drawn = [
        _peak(taus, table[:, random.integers(0, count, count)].sum(axis=1))[0] for _ in range(draws)
    ]
    low, high = np.percentile(drawn, [2.5, 97.5])
    jitter = float(np.std(delivered - even))
    return Latency(best, (float(low), float(high)), jitter, float(1 / period), peak)


def _stroke(motion: HandleStrokes, early: Vector, late: Vector) -> Vector:
    """Stroke that contains both times; 0 if there is none."""
    indices = [np.clip(np.searchsorted(motion.t, t), 0, len(motion.t) - 1) for t in (early, late)]
    first, last = (motion.stroke[index] for index in indices)
    known = (early >= motion.t[0]) & (late <= motion.t[-1])
    number: Vector = np.where((first == last) & known, first, 0)
    return number


def _sums(x: Vector, y: Vector, stroke: Vector, count: int) -> Vector:
    """Count, and sums of x x, y y and x y, of each stroke, without slow variation.

    Where more of the wires slips, the same handle motion bends the tip more. That is not a delay; a
    parabola fitted to each stroke removes it.
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
    """Latency of the largest absolute correlation, interpolated by a parabola."""
    _, xx, yy, xy = sums.T
    r = np.abs(xy) / np.sqrt(np.maximum(xx * yy, 1e-60))
    k = int(np.clip(r.argmax(), 1, len(r) - 2))
    bend = r[k - 1] - 2 * r[k] + r[k + 1]
    shift = 0.5 * (r[k - 1] - r[k + 1]) / bend if bend < 0 else 0.0
    return float(taus[k] + shift * STEP_S), float(r[k])
