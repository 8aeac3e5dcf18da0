"""Seeded picture sequences with known truth, for the tests and the benchmark of vision.

Source: the two paths, and a camera that wobbles, blurs and compresses, are the thesis'; the
occluders that pass or stop in front of the target are assumed.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from math import cos, sin, tau
from typing import Any, NamedTuple

import cv2
import numpy as np

from endolock.hw.api import Image
from endolock.twin.camera.stills import BoardPose, Studio
from endolock.twin.world import scenario as scenarios
from endolock.vision.grey import grey_of

RATE_HZ = 25.0
DISTANCE_M = 0.12
HALF_PX = 20
"""Half the side of the tracked window [px]; the hidden share refers to this window."""
PATHS = ("line", "circle")
HARD: dict[str, Any] = {"camera.noise": 6.0, "camera.jpeg_quality": 50}
PLATE_M = (0.06, 0.05)
PLATE_DISTANCE_M = 0.09
MEETING_S = 4.0
"""Time at which the centre of an occluder is in front of the target [s]."""


class LabelledPicture(NamedTuple):
    """One picture of a sequence with its ground truth."""

    grey: Image
    target_px: tuple[float, float]
    hidden: float
    """Share of the target's window behind an occluder [1]."""


class Occlusion(NamedTuple):
    """One sequence of the occlusion set."""

    board: str
    look: str
    style: str
    seed: int


OCCLUSIONS = tuple(
    Occlusion(*kind)
    for kind in product(
        ("rings", "tissue"), ("plain", "tissue", "decoy"), ("passing", "parking"), range(3)
    )
)
"""Two targets, behind plates that are plain, have the background's texture, or carry a decoy."""


def moving(
    path: str, frames: int, *, hard: bool = False, board: str = "rings"
) -> Iterator[LabelledPicture]:
    """Yield the pictures of a board that moves along a path.

    Args:
        path: one of `PATHS`.
        frames: number of pictures.
        hard: with a tip that wobbles by 8 px rms from frame to frame, motion blur, noise of 6 grey
            levels, JPEG at quality 50, gain between 0.5 and 1, and a size that changes by +-17 %.
        board: kind of board.
    """
    loaded = scenarios.load("rest", {"board.kind": board, **(HARD if hard else {})})

    def pose(t: float) -> BoardPose:
        if path == "line":
            x, y = 0.04 * sin(tau * t / 8.6), 0.0
        else:
            x, y = 0.035 * cos(tau * t / 10), 0.035 * sin(tau * t / 10)
        if not hard:
            return BoardPose((x, y, DISTANCE_M))
        x += 0.0055 * sin(tau * 1.7 * t) + 0.0045 * sin(tau * 2.9 * t)
        y += 0.0065 * sin(tau * 2.1 * t + 1)
        return BoardPose((x, y, DISTANCE_M * (1 + 0.17 * sin(tau * t / 7))))

    moments = (-0.008, -0.004, 0.0, 0.004, 0.008) if hard else (0.0,)
    with Studio(loaded) as studio:
        for n in range(frames):
            t = n / RATE_HZ
            still = studio.take(*(pose(t + moment) for moment in moments), t=t)
            grey = _grey(still.frame.image)
            if hard:
                gain = 0.75 + 0.25 * sin(tau * t / 3)
                grey = np.asarray(cv2.convertScaleAbs(grey, alpha=gain), np.uint8)
            yield LabelledPicture(grey, still.target_px, 0.0)


def occluded(kind: Occlusion, frames: int = 200) -> Iterator[LabelledPicture]:
    """Yield the pictures of one sequence of the occlusion set; the seed sets the motion."""
    words = [int.from_bytes(word.encode(), "little") for word in kind[:3]]
    random = np.random.default_rng([kind.seed, *words])
    speed, angle, phase = random.uniform(0.01, 0.12), *random.uniform(0, tau, 2)

    def board(t: float) -> tuple[float, float]:
        return 0.02 * sin(tau * t / 8.6 + phase), 0.015 * sin(tau * t / 6.1)

    velocity = speed * np.array([cos(angle), sin(angle)])
    met = np.array(board(MEETING_S)) * PLATE_DISTANCE_M / DISTANCE_M
    start_s = 0.2
    over_s = (MEETING_S - start_s) * (1 if kind.style == "parking" else 2)
    first = met - velocity * (MEETING_S - start_s)
    plate = {
        "look": kind.look,
        "size_m": PLATE_M,
        "distance_m": PLATE_DISTANCE_M,
        "position_m": tuple(first),
        "to_m": tuple(first + velocity * over_s),
        "start_s": start_s,
        "over_s": over_s,
    }
    overrides = {"board.kind": kind.board, "occluder": [plate]}
    loaded = scenarios.load("rest", overrides)
    with Studio(loaded) as studio:
        centre, focal_px = np.array(studio.calibration.centre_px), studio.calibration.focal_px
        for n in range(frames):
            t = n / RATE_HZ
            still = studio.take(BoardPose((*board(t), DISTANCE_M)), t=t)
            x, y, depth = loaded.occluder[0].position(t)
            middle = centre + focal_px * np.array([x, y]) / depth
            half = focal_px * np.array(PLATE_M) / 2 / depth
            hidden = _overlap(middle, half, np.array(still.target_px))
            yield LabelledPicture(_grey(still.frame.image), still.target_px, hidden)


def _grey(image: Image | None) -> Image:
    if image is None:
        raise ValueError("the frame carries no picture")
    return grey_of(image)


def _overlap(middle: np.ndarray, half: np.ndarray, target: np.ndarray) -> float:
    """Share of the target's window behind a plate [1]."""
    window = HALF_PX + 0.5
    low = np.maximum(middle - half, target - window)
    high = np.minimum(middle + half, target + window)
    return float(np.prod(np.maximum(high - low, 0.0)) / (2 * window) ** 2)
