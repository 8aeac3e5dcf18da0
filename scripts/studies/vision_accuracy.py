"""Accuracy of vision against exact projections: the figures of docs/vision.md."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from statistics import median
from typing import Any, NamedTuple

import cv2
import numpy as np

from endolock.control.rms import rms
from endolock.hw.api import Image
from endolock.scripts.studies import sequences
from endolock.twin.camera.stills import BoardPose, Studio
from endolock.twin.world import scenario as scenarios
from endolock.vision.feature_tracker import FeatureTracker
from endolock.vision.marker_eyes import MarkerEyes
from endolock.vision.reference import Affine, Reference, select
from endolock.vision.triple_check import TripleCheck

DISTANCES_M = (0.01, 0.015, 0.02, 0.03, 0.04, 0.06, 0.08, 0.12, 0.16)
POSES = 40
"""Poses per distance and condition, random within +-15 % of the distance sideways, +-25 deg of
tilt and +-20 deg of roll."""
OPTICS: dict[str, dict[str, Any]] = {
    "pinhole, f = 262 px": {},
    "fisheye 120 deg": {"camera.projection": "equidistant", "camera.mask": "octagon"},
    "fisheye 140 deg": {
        "camera.projection": "equidistant",
        "camera.diagonal_deg": 140.0,
        "camera.mask": "octagon",
    },
}
CONDITIONS: dict[str, tuple[dict[str, Any], float | None, float]] = {
    "nominal": ({}, None, 0.0),
    "tilt 45 deg": ({}, 45.0, 0.0),
    "tilt 60 deg": ({}, 60.0, 0.0),
    "tilt 75 deg": ({}, 75.0, 0.0),
    "motion blur 3 px": ({}, None, 3.0),
    "motion blur 7 px": ({}, None, 7.0),
    "motion blur 10 px": ({}, None, 10.0),
    "noise 5": ({"camera.noise": 5.0}, None, 0.0),
    "noise 20": ({"camera.noise": 20.0}, None, 0.0),
    "gain 0.3": ({"camera.gain": 0.3}, None, 0.0),
    "gain 0.1": ({"camera.gain": 0.1}, None, 0.0),
    "JPEG 30": ({"camera.jpeg_quality": 30}, None, 0.0),
    "JPEG 15": ({"camera.jpeg_quality": 15}, None, 0.0),
    "tip light alone": ({"light.room": 0.0, "light.falls_off": True}, None, 0.0),
    "back light alone": ({"light.room": 0.0, "light.tip": 0.0, "light.back": 1.0}, None, 0.0),
    "a third hidden": ({}, None, 0.0),
    "two thirds hidden": ({}, None, 0.0),
}
"""Overrides of the scenario, tilt if it is not random [deg], and length of the blur [px]."""
HIDDEN = {"a third hidden": 1 / 3, "two thirds hidden": 2 / 3}
WINDOWS = (12, 16, 20, 24, 30, 40)
FRAMES = 300
WRONG_PX = 3.0


class MarkerAccuracy(NamedTuple):
    """Accuracy of markers in one series of pictures."""

    found: float
    pixel_rms: float
    pixel_max: float
    depth_rms: float
    """Relative [1]."""
    ms: float


class TrackerAccuracy(NamedTuple):
    """Accuracy of the tracker in one sequence."""

    accepted: int
    refused: int
    rms_px: float
    max_px: float
    ms: float


class OcclusionResult(NamedTuple):
    """Result of the tracker on the occlusion set."""

    hidden: int
    """Frames with more than 60 % of the window hidden."""
    accepted_hidden: int
    accepted: int
    wrong: int
    """Accepted frames off by more than `WRONG_PX`."""
    worst_px: float
    latest: int
    """Most frames with the target in sight before it was accepted again."""


def markers(
    overrides: dict[str, Any],
    distance_m: float,
    *,
    tilt_deg: float | None = None,
    blur_px: float = 0.0,
    hidden: float = 0.0,
    poses: int = POSES,
) -> MarkerAccuracy:
    """Measure the board at random poses, the same for every condition."""
    random = np.random.default_rng(11)
    if hidden:
        overrides = {**overrides, "occluder": [_plate(distance_m, hidden)]}
    loaded = scenarios.load("rest", {**overrides, "board.distance_m": distance_m})
    off, depth, taken = [], [], []
    with Studio(loaded) as studio:
        eyes = MarkerEyes(studio.calibration, studio.board)
        for _ in range(poses):
            x, y = random.uniform(-0.15, 0.15, 2) * distance_m
            tilt, axis, roll = random.uniform([-25, 0, -20], [25, 180, 20])
            tilt = tilt if tilt_deg is None else tilt_deg
            length = blur_px * distance_m / studio.calibration.focal_px
            shifts = np.linspace(-0.5, 0.5, 9 if blur_px else 1) * length if blur_px else [0.0]
            blurred = [BoardPose((x + s, y, distance_m), tilt, axis, roll) for s in shifts]
            still = studio.take(*blurred)
            start = time.perf_counter()
            _, fit = eyes.look(still.frame)
            taken.append(time.perf_counter() - start)
            if not isinstance(fit, str):
                off.append(np.hypot(*np.subtract(fit.pixel, still.target_px)))
                depth.append(fit.distance_m / still.distance_m - 1)
    found = len(off) / poses
    if not off:
        return MarkerAccuracy(0.0, np.nan, np.nan, np.nan, 1e3 * median(taken))
    return MarkerAccuracy(
        found, rms(np.array(off)), max(off), rms(np.array(depth)), 1e3 * median(taken)
    )


def follow(sights: Iterator[sequences.LabelledPicture], half: int) -> TrackerAccuracy:
    """Let the tracker follow a sequence from its first picture."""
    first = next(sights)
    tracker = FeatureTracker(first.grey, first.target_px, (half, half))
    off, taken, refused = [], [], 0
    for sight in sights:
        start = time.perf_counter()
        track = tracker.step(sight.grey)
        taken.append(time.perf_counter() - start)
        if isinstance(track, str):
            refused += 1
        else:
            off.append(np.hypot(*np.subtract(track.pixel, sight.target_px)))
    if not off:
        return TrackerAccuracy(0, refused, np.nan, np.nan, 1e3 * median(taken))
    return TrackerAccuracy(len(off), refused, rms(np.array(off)), max(off), 1e3 * median(taken))


def hide(kinds: Sequence[sequences.Occlusion]) -> OcclusionResult:
    """Run the tracker on targets that are temporarily hidden."""
    hidden = accepted_hidden = accepted = wrong = latest = 0
    worst = 0.0
    for kind in kinds:
        sights = sequences.occluded(kind)
        first = next(sights)
        tracker = FeatureTracker(first.grey, first.target_px, (sequences.HALF_PX,) * 2)
        plain = 0
        for sight in sights:
            track = tracker.step(sight.grey)
            plain = plain + 1 if sight.hidden == 0.0 else 0
            covered = sight.hidden > 0.6
            hidden += covered
            if isinstance(track, str):
                latest = max(latest, plain)
                continue
            accepted += 1
            accepted_hidden += covered
            off = float(np.hypot(*np.subtract(track.pixel, sight.target_px)))
            worst = max(worst, off)
            wrong += off > WRONG_PX
    return OcclusionResult(hidden, accepted_hidden, accepted, wrong, worst, latest)


def _plate(distance_m: float, share: float) -> dict[str, Any]:
    """Return an occluder that covers the board from the right, up to a share of its width."""
    depth = 0.9 * distance_m
    edge = (0.05 - 0.10 * share) * 0.9
    position = (edge + 0.2, 0.0)
    return {
        "size_m": (0.4, 0.4),
        "distance_m": depth,
        "position_m": position,
        "to_m": position,
        "start_s": 0.0,
        "over_s": 1.0,
    }


def triple(kinds: Sequence[sequences.Occlusion]) -> tuple[list[float], list[float]]:
    """Apply the triple check alone to a follower that only compares consecutive frames.

    Such a follower takes everything that moves in its window for the target, and ends on the
    occluder.

    Returns:
        The check's distances [px] in frames where the follower was right, and where it was wrong.
    """
    right: list[float] = []
    wrong: list[float] = []
    for kind in kinds:
        sights = sequences.occluded(kind)
        first = next(sights)
        reference = select(first.grey, complex(*first.target_px), (sequences.HALF_PX,) * 2)
        assert not isinstance(reference, str)
        check = TripleCheck(reference.offsets)
        seen = Affine(complex(*first.target_px))
        check.accept(first.grey, seen)
        before = first.grey
        for sight in sights:
            seen = seen._replace(
                position=seen.position + _drift(before, sight.grey, seen, reference)
            )
            check.refusal(sight.grey, seen)
            if check.ready:
                off = abs(seen.position - complex(*sight.target_px))
                (right if off < WRONG_PX else wrong).append(check.distance_px)
            check.accept(sight.grey, seen)
            before = sight.grey
    return right, wrong


def _drift(before: Image, now: Image, seen: Affine, reference: Reference) -> complex:
    """Median motion of the window's points from one picture to the next [px]."""
    points = seen.position + seen.moves(reference.offsets)
    start = np.column_stack([points.real, points.imag]).astype(np.float32)
    ends, ok, _ = cv2.calcOpticalFlowPyrLK(before, now, start, start.copy(), maxLevel=2)
    moved = (ends - start)[ok.ravel() > 0]
    return complex(*np.median(moved, axis=0).tolist()) if len(moved) else 0j
