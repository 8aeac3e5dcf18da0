"""Scores of a run: how far the target was from the image centre, and what the handles did.

`error_px` is the present true error, at every tick from `scored_from_s` on, also with the target
outside the picture; `delayed_error_px` is the error measured by vision, the only one on a bench.
Errors are limited to `BEHIND_PX`, which is also the error of a target behind the camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import isfinite

import numpy as np

from endolock.control.loop import Run, Seen, Tick
from endolock.control.rms import rms
from endolock.control.scores import (
    ErrorExtent,
    ErrorSummary,
    HandleScores,
    Scores,
    TipScores,
)
from endolock.hw.api import Calibration, TruthSample, Vector
from endolock.vision import camera_model
from endolock.vision.observation import Status

LOCKED_PX = 20.0
LOCKED_FOR_S = 2.0
"""The target counts as locked once its error has been below this [px] for this time [s]."""
REVERSAL_RAD = 0.006
"""Motion back that counts as a reversal of a handle [rad]: four counts of its encoder."""
EXPOSURE_S = 0.020
"""Exposure time for which motion blur is computed [s]. Assumed."""
BEHIND_PX = 1e4
"""Error of a target that is not ahead of the camera, and the largest error [px]. Assumed."""


def score(run: Run, calibration: Calibration, scored_from_s: float) -> Scores:
    """Compute every metric of a run.

    Args:
        run: its ticks and frames.
        calibration: calibration of the tip camera, for the image centre.
        scored_from_s: start of errors, `handle`, `tip` and `blur_px`, counted from the first tick
            [s]; counts and fractions of frames, the lost fraction and the time to lock are of the
            whole run.

    Returns:
        The scores. On a bench, which has no truth, the true errors are None; the error of vision
        is then measured against the markers around a target that was followed without them.
    """
    begin = scored_from_s - 1e-9 + (run.ticks[0].t if run.ticks else 0.0)
    ticks = [tick for tick in run.ticks if tick.t >= begin]
    seen = [s for s in run.seen if s.frame.t_available >= begin]
    accepted = [s for s in seen if s.observation.status is Status.TRACKING]
    delayed = [_radius(calibration, s.observation.target_px) for s in accepted]
    known = [tick.truth for tick in ticks if tick.truth]
    on_a_bench = bool(run.ticks) and run.ticks[0].truth is None
    error = np.array([_radius(calibration, truth.target_px) for truth in known])
    degrees = np.array([truth.error_deg for truth in known])
    return Scores(
        overruns=sum(tick.skipped for tick in run.ticks),
        frames=len(run.seen),
        frames_dropped=sum(s.frame.dropped for s in run.seen),
        detected_fraction=_share([s.observation.status is Status.TRACKING for s in run.seen]),
        lost_fraction=_share([tick.status is Status.LOST for tick in run.ticks]),
        time_to_lock_s=_time_to_lock(run.ticks, calibration),
        error_px=None if on_a_bench else summary(error),
        error_deg=None if on_a_bench else _extent(degrees),
        delayed_error_px=summary(np.array(delayed)),
        vision_error_px=_vision_error(accepted, on_a_bench),
        handle=_handle(ticks),
        tip=None if on_a_bench else _tip(known),
        blur_px=_blur(ticks),
    )


def _radius(calibration: Calibration, pixel: tuple[float, float]) -> float:
    right, down = camera_model.offset(calibration, pixel)
    return min(float(np.hypot(right, down)), BEHIND_PX) if isfinite(right) else BEHIND_PX


def summary(error: Vector) -> ErrorSummary:
    """Summarise errors: rms, 95th percentile, maximum, mean [px], fractions within 20 and 50 px.

    Args:
        error: distances from the image centre, n [px]; every figure is None for n = 0.
    """
    if not error.size:
        return ErrorSummary()
    return ErrorSummary(
        rms=rms(error),
        p95=float(np.percentile(error, 95)),
        max=float(error.max()),
        mean=float(error.mean()),
        within_20=float((error <= 20).mean()),
        within_50=float((error <= 50).mean()),
    )


def _extent(error: Vector) -> ErrorExtent:
    if not error.size:
        return ErrorExtent()
    return ErrorExtent(rms=rms(error), max=float(error.max()))


def _vision_error(accepted: Sequence[Seen], on_a_bench: bool) -> ErrorExtent | None:
    """Distance of the accepted pixels from the truth; on a bench from the markers around them."""
    error = []
    for s in accepted:
        true = s.truth.target_px if s.truth else s.observation.reference_px
        if isfinite(true[0]):
            error.append(np.hypot(*np.subtract(s.observation.target_px, true)))
    return _extent(np.array(error)) if error or not on_a_bench else None


def _time_to_lock(ticks: Sequence[Tick], calibration: Calibration) -> float | None:
    """First time after which the error stays below `LOCKED_PX` for `LOCKED_FOR_S` [s]."""
    since: float | None = None
    for tick in ticks:
        if not tick.truth or _radius(calibration, tick.truth.target_px) >= LOCKED_PX:
            since = None
        elif since is None:
            since = tick.t
        elif tick.t - since >= LOCKED_FOR_S - 1e-9:
            return since - ticks[0].t
    return None


def _handle(ticks: Sequence[Tick]) -> HandleScores:
    """Motion of both handles together, from measured positions and speeds; p2p_deg of each."""
    if len(ticks) < 4 or ticks[-1].state.t <= ticks[0].state.t:
        return HandleScores()
    t = np.array([tick.state.t for tick in ticks])
    position = np.array([tick.state.position for tick in ticks])
    rate = np.array([tick.state.velocity for tick in ticks])
    dt = (t[-1] - t[0]) / (len(t) - 1)
    accel = np.diff(rate, axis=0) / dt
    jerk = np.diff(accel, axis=0) / dt
    reversals = sum(_reversals(axis.tolist()) for axis in position.T)
    return HandleScores(
        rate_rms=rms(np.linalg.norm(rate, axis=1)),
        accel_rms=rms(np.linalg.norm(accel, axis=1)),
        jerk_rms=rms(np.linalg.norm(jerk, axis=1)),
        travel_rad=float(np.abs(np.diff(position, axis=0)).sum()),
        reversals_per_s=reversals / float(t[-1] - t[0]),
        p2p_deg=np.degrees(np.ptp(position, axis=0)).tolist(),
    )


def _tip(known: Sequence[TruthSample]) -> TipScores:
    """True motion of the tip on each axis [deg]: peak to peak, and distance travelled."""
    if not known:
        return TipScores()
    bend = np.degrees([truth.plant.bend_rad for truth in known])
    return TipScores(
        p2p_deg=np.ptp(bend, axis=0).tolist(),
        travel_deg=np.abs(np.diff(bend, axis=0)).sum(axis=0).tolist(),
    )


def _reversals(position: list[float]) -> int:
    """Count changes of direction, ignoring those smaller than `REVERSAL_RAD`."""
    count, direction, extreme = 0, 0, position[0]
    for p in position:
        if direction * (p - extreme) > 0:
            extreme = p
        elif abs(p - extreme) >= REVERSAL_RAD:
            count += direction != 0
            direction, extreme = (1 if p > extreme else -1), p
    return count


def _blur(ticks: Sequence[Tick]) -> float | None:
    """Mean motion of the target's image within one exposure [px]."""
    pairs = [(a, b) for a, b in pairwise(ticks) if a.truth and b.truth]
    speeds = [
        np.hypot(*np.subtract(b.truth.target_px, a.truth.target_px)) / (b.t - a.t)
        for a, b in pairs
        if a.truth and b.truth
    ]
    finite = [s for s in speeds if isfinite(s)]
    return float(np.mean(finite)) * EXPOSURE_S if finite else None


def _share(facts: Sequence[bool]) -> float | None:
    return float(np.mean(facts)) if facts else None
