"""Calibrates a camera from a recording of a board, taken from several directions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal

from endolock.hw.api import Calibration, ConfigError
from endolock.scripts.runs import recordings
from endolock.vision import calibration as calibrations
from endolock.vision.detector import Marker, MarkerDetector
from endolock.vision.grey import grey_of, smoothed

UNFLIP = "switch that off where the picture is made, and record it again"


def calibrate(
    source: Path,
    *,
    times: Path | None = None,
    board: str | None = None,
    projection: Literal["pinhole", "equidistant"] = "pinhole",
    progress: Callable[[str], None] = lambda _step: None,
) -> Calibration:
    """Calibrate the camera of a recording.

    Args:
        source: run folder, or video file.
        times: CSV file with the time stamps of a video.
        board: kind of board; that of the run, or rings, if None.
        projection: projection of the lens; equidistant is a fisheye.
        progress: called with each step, in words.

    Raises:
        ConfigError: something is missing or cannot be read, or the views do not determine the
            camera.
    """
    recording = recordings.open_(source, times=times, calibration=None, board=board)
    detect = MarkerDetector(recording.board)
    views: list[list[Marker]] = []
    flipped = 0
    size: tuple[int, int] | None = None
    progress("detecting the board")
    for frame in recording.frames:
        if frame.image is None or frame.repeated:
            continue
        height, width, _ = frame.image.shape
        if size not in (None, (width, height)):
            raise ConfigError(f"pictures of {source} differ in size", "use pictures of one camera")
        size = width, height
        found, mirrored = detect.look(smoothed(grey_of(frame.image)))
        views.append(found)
        flipped += mirrored > len(found)
    if flipped > len(views) / 2:
        raise ConfigError(f"{source} is mirrored: the camera's picture is flipped", UNFLIP)
    progress("calibrating")
    return calibrations.calibrate(views, recording.board, size or (0, 0), projection)
