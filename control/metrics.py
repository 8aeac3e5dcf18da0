"""Scores of a run: how far the target was from the image centre, and what the handles did.

`error_px` is the present true error, at every tick from `scored_from_s` on, also with the target
outside the picture; `delayed_error_px` is the error measured by vision, the only one on a bench.
Errors are limited to `BEHIND_PX`, which is also the error of a target behind the camera.
"""

from __future__ import annotations

from math import isfinite

import numpy as np

from endolock.control.loop import Run, Seen, Tick
from endolock.control.numbers_kept import Numbers, Travel
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
LARGE_REVERSAL_RAD = 0.1
"""Motion back that counts as a large reversal [rad]: 6 deg, which the hand at the handle sees.
Assumed."""
FAST_RAD_S = 2.0
"""Speed of both handles together that counts as fast [rad/s]. Assumed: people turn them more
slowly."""
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
            [s]; `startup_error_px` is of the time before it; counts and fractions of frames, the
            lost fraction and the time to lock are of the whole run.
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
        self._ticks = self._scored_ticks = self._lost = self._overruns = 0
        self._frames = self._accepted = self._dropped = 0
        self._since: float | None = None
        self._locked_s: float | None = None
        self._last: Tick | None = None
        # Of the scored ticks; those of the truth where it is known.
        self._state_ts: tuple[float, float] | None = None
        self._position, self._rate = Numbers(), Numbers()
        self._error, self._error_deg, self._image_speed = Numbers(), Numbers(), Numbers()
        self._startup = Numbers()
        self._bend_deg = Travel()
        # Of the accepted frames delivered in the scored part.
        self._delayed, self._vision = Numbers(), Numbers()
        self._early: list[tuple[float, float, float]] = []
        """What `_judge` takes, of the frames before the first tick."""

    def tick(self, tick: Tick) -> None:
        """Take one control period."""
        truth = tick.truth
        if self.began_t is None:
            self.began_t, self._on_a_bench = tick.t, truth is None
            self._begin = self._scored_from_s - 1e-9 + tick.t
            self._take_early()
        self.ran_s = tick.t - self.began_t
        self._ticks += 1
        self._lost += tick.status is Status.LOST
        self._overruns += tick.skipped
        error = _radius(self._calibration, truth.target_px) if truth else None
        self._look_for_lock(tick.t, error)
        if tick.t < self._begin:
            if error is not None:
                self._startup.append(error)
            return
        first, _ = self._state_ts or (tick.state.t, 0.0)
        self._state_ts = first, tick.state.t
        self._scored_ticks += 1
        self._position.append(*tick.state.position)
        self._rate.append(*tick.state.velocity)
        if truth and error is not None:
            self._error.append(error)
            self._error_deg.append(truth.error_deg)
            self._bend_deg.append(np.degrees(truth.plant.bend_rad).tolist())
        if truth and self._last and self._last.truth:
            moved = np.hypot(*np.subtract(truth.target_px, self._last.truth.target_px))
            if isfinite(speed := moved / (tick.t - self._last.t)):
                self._image_speed.append(speed)
        self._last = tick

    def seen(self, seen: Seen) -> None:
        """Take one frame."""
        self._frames += 1
        self._dropped += seen.frame.dropped
        if seen.observation.status is not Status.TRACKING:
            return
        self._accepted += 1
        pixel = seen.observation.target_px
        # The truth; on a bench the markers around the target.
        true = seen.truth.target_px if seen.truth else seen.observation.reference_px
        off = float(np.hypot(*np.subtract(pixel, true)))
        judged = seen.frame.t_available, _radius(self._calibration, pixel), off
        if self.began_t is None:
            self._early.append(judged)
        else:
            self._judge(*judged)

    def scores(self) -> Scores:
        """Return the scores of all that was taken."""
        self._take_early()
        simulated = not self._on_a_bench
        vision = self._vision.all()
        return Scores(
            overruns=self._overruns,
            frames=self._frames,
            frames_dropped=self._dropped,
            detected_fraction=self._accepted / self._frames if self._frames else None,
            lost_fraction=self._lost / self._ticks if self._ticks else None,
            time_to_lock_s=self._locked_s,
            error_px=summary(self._error.all()) if simulated else None,
            startup_error_px=summary(self._startup.all()) if simulated else None,
            error_deg=_extent(self._error_deg.all()) if simulated else None,
            delayed_error_px=summary(self._delayed.all()),
            vision_error_px=_extent(vision) if vision.size or simulated else None,
            handle=self._handle(),
            tip=self._tip() if simulated else None,
            blur_px=self._blur(),
        )

    def _take_early(self) -> None:
        """Judge the frames before the first tick, from which the scored part is counted."""
        early, self._early = self._early, []
        for judged in early:
            self._judge(*judged)

    def _judge(self, t_available: float, delayed: float, vision: float) -> None:
        """Keep the errors of an accepted frame, if it was delivered in the scored part."""
        if t_available >= self._begin:
            self._delayed.append(delayed)
            if isfinite(vision):
                self._vision.append(vision)

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
        speed = self._image_speed.all()
        if self._exposure_s is None or not speed.size:
            return None
        return float(np.mean(speed)) * self._exposure_s

    def _tip(self) -> TipScores:
        """True motion of the tip on each axis [deg]: peak to peak, and distance travelled."""
        p2p_deg, travel_deg = self._bend_deg.moved or (None, None)
        return TipScores(p2p_deg=p2p_deg, travel_deg=travel_deg)

    def _handle(self) -> HandleScores:
        """Motion of both handles together, from measured positions and speeds; p2p_deg of each."""
        first, last = self._state_ts or (0.0, 0.0)
        n = self._scored_ticks
        if n < 4 or last <= first:
            return HandleScores()
        position = self._position.all().reshape(n, -1)
        rate = self._rate.all().reshape(n, -1)
        dt = (last - first) / (n - 1)
        accel = np.diff(rate, axis=0) / dt
        jerk = np.diff(accel, axis=0) / dt
        speed = np.linalg.norm(rate, axis=1)
        small, large = (
            sum(_reversals(axis.tolist(), least) for axis in position.T) / (last - first)
            for least in (REVERSAL_RAD, LARGE_REVERSAL_RAD)
        )
        return HandleScores(
            rate_rms=rms(speed),
            accel_rms=rms(np.linalg.norm(accel, axis=1)),
            jerk_rms=rms(np.linalg.norm(jerk, axis=1)),
            travel_rad=float(np.abs(np.diff(position, axis=0)).sum()),
            reversals_per_s=small,
            large_reversals_per_s=large,
            fast_share=float((speed > FAST_RAD_S).mean()),
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


def _reversals(position: list[float], least_rad: float) -> int:
    """Count changes of direction, ignoring those smaller than `least_rad`."""
    count, direction, extreme = 0, 0, position[0]
    for p in position:
        if direction * (p - extreme) > 0:
            extreme = p
        elif abs(p - extreme) >= least_rad:
            count += direction != 0
            direction, extreme = (1 if p > extreme else -1), p
    return count
