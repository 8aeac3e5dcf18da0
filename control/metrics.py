"""Scores of a run: how far the target was from the image centre, and what the handles did.

`error_px` is the present true error, at every tick from `scored_from_s` on, also with the target
outside the picture; `delayed_error_px` is the error measured by vision, the only one on a bench.
Errors are limited to `BEHIND_PX`, which is also the error of a target behind the camera.
"""

from __future__ import annotations

from array import array
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
from endolock.hw.api import Calibration, Vector
from endolock.vision import camera_model
from endolock.vision.observation import Status

LOCKED_PX = 20.0
LOCKED_FOR_S = 2.0
"""The target counts as locked once its error has been below this [px] for this time [s]."""
REVERSAL_RAD = 0.006
"""Motion back that counts as a reversal of a handle [rad]: four counts of its encoder."""
BEHIND_PX = 1e4
"""Error of a target that is not ahead of the camera, and the largest error [px]. Assumed."""


def score(
    run: Run, calibration: Calibration, scored_from_s: float, exposure_s: float | None = None
) -> Scores:
    """Compute every metric of a run.

    Args:
        run: its ticks and frames.
        calibration: calibration of the tip camera, for the image centre.
        scored_from_s: start of errors, `handle`, `tip` and `blur_px`, counted from the first tick
            [s]; counts and fractions of frames, the lost fraction and the time to lock are of the
            whole run.
        exposure_s: exposure time of the camera, for `blur_px` [s]; None where it is not known.

    Returns:
        The scores. On a bench, which has no truth, the true errors are None; the error of vision
        is then measured against the markers around a target that was followed without them.
    """
    scorer = Scorer(calibration, scored_from_s, exposure_s)
    for tick in run.ticks:
        scorer.tick(tick)
    for seen in run.seen:
        scorer.seen(seen)
    return scorer.scores()


class Scorer:
    """Scores a run while it goes on; a recorder that keeps numbers instead of rows.

    Args:
        calibration: calibration of the tip camera, for the image centre.
        scored_from_s: as for `score` [s].
        exposure_s: as for `score` [s].
    """

    def __init__(
        self, calibration: Calibration, scored_from_s: float, exposure_s: float | None = None
    ) -> None:
        self._calibration, self._scored_from_s = calibration, scored_from_s
        self._exposure_s = exposure_s
        self.began_t: float | None = None
        """Time of the first tick [s]; None before it."""
        self.ran_s = 0.0
        """From the first tick to the last [s]."""
        self._begin = scored_from_s - 1e-9
        self._on_a_bench = False
        self._ticks = self._lost = self._overruns = 0
        self._frames = self._accepted = self._dropped = 0
        self._since: float | None = None
        self._locked_s: float | None = None
        self._last: Tick | None = None
        # Of the scored ticks; those of the truth where it is known.
        self._state_t, self._position, self._rate = array("d"), array("d"), array("d")
        self._error, self._error_deg, self._bend = array("d"), array("d"), array("d")
        self._image_speed = array("d")
        # Of the accepted frames: time of delivery and error, in turn.
        self._delayed, self._vision = array("d"), array("d")

    def tick(self, tick: Tick) -> None:
        """Take one control period."""
        truth = tick.truth
        if self.began_t is None:
            self.began_t, self._on_a_bench = tick.t, truth is None
            self._begin = self._scored_from_s - 1e-9 + tick.t
        self.ran_s = tick.t - self.began_t
        self._ticks += 1
        self._lost += tick.status is Status.LOST
        self._overruns += tick.skipped
        error = _radius(self._calibration, truth.target_px) if truth else None
        self._look_for_lock(tick.t, error)
        if tick.t < self._begin:
            return
        self._state_t.append(tick.state.t)
        self._position.extend(tick.state.position)
        self._rate.extend(tick.state.velocity)
        if truth and error is not None:
            self._error.append(error)
            self._error_deg.append(truth.error_deg)
            self._bend.extend(truth.plant.bend_rad)
        if truth and self._last and self._last.truth:
            moved = np.hypot(*np.subtract(truth.target_px, self._last.truth.target_px))
            if isfinite(speed := moved / (tick.t - self._last.t)):
                self._image_speed.append(speed)
        self._last = tick

    def seen(self, seen: Seen) -> None:
        """Take one frame."""
        observation, at = seen.observation, seen.frame.t_available
        self._frames += 1
        self._dropped += seen.frame.dropped
        if observation.status is not Status.TRACKING:
            return
        self._accepted += 1
        self._delayed.extend((at, _radius(self._calibration, observation.target_px)))
        # The truth; on a bench the markers around the target.
        true = seen.truth.target_px if seen.truth else observation.reference_px
        if isfinite(true[0]):
            off = float(np.hypot(*np.subtract(observation.target_px, true)))
            self._vision.extend((at, off))

    def scores(self) -> Scores:
        """Return the scores of all that was taken."""
        simulated = not self._on_a_bench
        vision = self._scored(self._vision)
        return Scores(
            overruns=self._overruns,
            frames=self._frames,
            frames_dropped=self._dropped,
            detected_fraction=self._accepted / self._frames if self._frames else None,
            lost_fraction=self._lost / self._ticks if self._ticks else None,
            time_to_lock_s=self._locked_s,
            error_px=summary(np.array(self._error)) if simulated else None,
            error_deg=_extent(np.array(self._error_deg)) if simulated else None,
            delayed_error_px=summary(self._scored(self._delayed)),
            vision_error_px=_extent(vision) if vision.size or simulated else None,
            handle=self._handle(),
            tip=_tip(np.array(self._bend).reshape(-1, 2)) if simulated else None,
            blur_px=self._blur(),
        )

    def _scored(self, pairs: array[float]) -> Vector:
        """Return the errors of the frames delivered in the scored part."""
        at, error = np.array(pairs).reshape(-1, 2).T
        return np.ascontiguousarray(error[at >= self._begin])

    def _look_for_lock(self, t: float, error: float | None) -> None:
        """Find the first time after which the error stays low for `LOCKED_FOR_S`."""
        if error is None or error >= LOCKED_PX:
            self._since = None
        elif self._since is None:
            self._since = t
        elif self._locked_s is None and t - self._since >= LOCKED_FOR_S - 1e-9:
            self._locked_s = self._since - (self.began_t or 0.0)

    def _blur(self) -> float | None:
        """Mean motion of the target's image within one exposure [px]."""
        if self._exposure_s is None or not self._image_speed:
            return None
        return float(np.mean(self._image_speed)) * self._exposure_s

    def _handle(self) -> HandleScores:
        """Motion of both handles together, from measured positions and speeds; p2p_deg of each."""
        t = np.array(self._state_t)
        if len(t) < 4 or t[-1] <= t[0]:
            return HandleScores()
        position = np.array(self._position).reshape(len(t), -1)
        rate = np.array(self._rate).reshape(len(t), -1)
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


def _tip(bend_rad: Vector) -> TipScores:
    """True motion of the tip on each axis, from its bends, n x 2 [rad]."""
    if not bend_rad.size:
        return TipScores()
    bend = np.degrees(bend_rad)
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
