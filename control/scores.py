"""Scores of a run as typed records; their field names are the keys of the run record in JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from endolock.hw.frozen import Frozen


@dataclass(frozen=True, kw_only=True)
class ErrorSummary:
    """Distance of the target from the image centre; every field is None without samples."""

    rms: float | None = None
    """Root mean square [px]."""
    p95: float | None = None
    """95th percentile [px]."""
    max: float | None = None
    """Largest [px]."""
    mean: float | None = None
    """Mean [px]."""
    within_20: float | None = None
    """Share of samples within 20 px [1]."""
    within_50: float | None = None
    """Share of samples within 50 px [1]."""


@dataclass(frozen=True, kw_only=True)
class ErrorExtent:
    """Rms and largest value of an error, in the unit of the field that holds it."""

    rms: float | None = None
    """Root mean square; None without samples."""
    max: float | None = None
    """Largest value; None without samples."""


@dataclass(frozen=True, kw_only=True)
class HandleScores(Frozen):
    """Motion of the handles, from measured angles and speeds; None for fewer than four ticks."""

    rate_rms: float | None = None
    """Speed of both handles together, rms [rad/s]."""
    accel_rms: float | None = None
    """Acceleration of both handles together, rms [rad/s2]."""
    jerk_rms: float | None = None
    """Jerk of both handles together, rms [rad/s3]."""
    travel_rad: float | None = None
    """Distance travelled, summed over both handles [rad]."""
    reversals_per_s: float | None = None
    """Changes of direction of both handles, by 6 mrad or more [1/s]."""
    large_reversals_per_s: float | None = None
    """Changes of direction of both handles, by 0.1 rad or more [1/s]."""
    fast_share: float | None = None
    """Share of the time in which both handles together turn faster than 2 rad/s [1]."""
    p2p_deg: tuple[float, ...] | None = None
    """Peak to peak of each handle (up_down, left_right) [deg]."""


@dataclass(frozen=True, kw_only=True)
class TipScores(Frozen):
    """True motion of the tip (up_down, left_right); None without samples."""

    p2p_deg: tuple[float, ...] | None = None
    """Peak to peak [deg]."""
    travel_deg: tuple[float, ...] | None = None
    """Distance travelled [deg]."""


@dataclass(frozen=True, kw_only=True)
class Scores(Frozen):
    """What a run is scored by; see `control.metrics.score`.

    Errors and motions are of the scored part, counts and shares of the whole run.
    """

    overruns: int
    """Control periods that were skipped because a tick came late."""
    frames: int
    """Delivered frames."""
    frames_dropped: int
    """Exposures that were never delivered."""
    detected_fraction: float | None
    """Share of delivered frames in which the target was accepted [1]; None without frames."""
    lost_fraction: float | None
    """Share of ticks in state LOST [1]; None without ticks."""
    time_to_lock_s: float | None
    """First time after which the error stays below 20 px for 2 s [s]; None if it never does."""
    error_px: ErrorSummary | None
    """True error at each tick [px]; None on a bench."""
    startup_error_px: ErrorSummary | None = None
    """True error before the scored part [px], while a controller learns; None on a bench."""
    error_deg: ErrorExtent | None
    """True angle between optical axis and target [deg]; None on a bench."""
    delayed_error_px: ErrorSummary
    """Error that vision measured in each accepted frame [px]."""
    vision_error_px: ErrorExtent | None
    """Error of the measured target pixel itself [px]; None where nothing is known to judge it."""
    handle: HandleScores
    tip: TipScores | None
    """True motion of the tip; None on a bench."""
    blur_px: float | None
    """Mean motion of the target's image during one exposure of the camera [px]: 0 for an ideal
    camera, whose exposures take no time; None on a bench, and where the exposure is not known."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values by name, as `--json` and metrics.json hold them."""
        return asdict(self)
