"""Recorded video as a camera: pictures delivered at their recorded times.

Vision gets the same frames as during the recording; sleeping takes no wall-clock time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import count
from pathlib import Path

import cv2
import numpy as np

from endolock.hw.api import Calibration, ConfigError, Frame, Image
from endolock.hw.camera.picture_source import PictureSource


class PlaybackClock:
    """Time of a recording; sleeping on it takes no wall-clock time.

    Args:
        start: start time [s].
    """

    realtime = False
    timestep_s = 0.0

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        """Time in the recording [s]."""
        return self._now

    def sleep_until(self, t: float) -> float:
        """Advance to `t` [s], unless it has passed."""
        self._now = max(self._now, t)
        return self._now


class RecordedCamera:
    """Delivers recorded frames when the clock reaches their times of delivery.

    Args:
        calibration: geometry of the camera that took them.
        clock: clock of the playback.
        frames: in order of delivery; consumed one by one.
    """

    def __init__(
        self, calibration: Calibration, clock: PlaybackClock, frames: Iterable[Frame]
    ) -> None:
        self.calibration = calibration
        self._clock, self._frames = clock, iter(frames)
        self._next = next(self._frames, None)
        self._newest: Frame | None = None

    @property
    def due(self) -> float | None:
        """Time of delivery of the next frame [s]; None after the last."""
        return None if self._next is None else self._next.t_available

    def latest(self) -> Frame | None:
        """Return the newest frame delivered, or None before the first."""
        while self._next is not None and self._next.t_available <= self._clock.now() + 1e-9:
            self._newest, self._next = self._next, next(self._frames, None)
        return self._newest


def video(path: Path, stamps: list[tuple[float, float]]) -> Iterator[Frame]:
    """Yield the frames of a video file with their time stamps.

    Where the file ends or is damaged before the time stamps do, the frames carry no picture.

    Raises:
        ConfigError: it cannot be opened, has more frames than time stamps, or consists of several
            recordings.
    """
    if not path.is_file():
        raise ConfigError(f"cannot open {path} as a video", "give a run folder or a video file")
    reader = PictureSource(str(path.resolve()), (0, 0), None)
    try:
        if not reader.opened:
            raise ConfigError(f"cannot open {path} as a video", "give a run folder or a video file")
        before: Image | None = None
        for seq in count():
            image = _read(reader)
            if image is not None and reader.restarted():
                raise ConfigError(
                    f"{path} begins anew at its picture {seq}, perhaps in another size",
                    "give each recording by itself",
                )
            if seq >= len(stamps) and image is None:
                return
            if seq >= len(stamps):
                raise ConfigError(
                    f"{path} has more than the {len(stamps)} frames that have time stamps",
                    "give one row per frame with --times",
                )
            if seq == 0 and image is None:
                raise ConfigError(f"{path} has no picture that can be decoded", "record it again")
            same = image is not None and before is not None and np.array_equal(image, before)
            early, late = stamps[seq]
            yield Frame(
                image=image, t_capture=early, t_available=late, seq=seq, dropped=0, repeated=same
            )
            before = image
    finally:
        reader.release()


def _read(reader: PictureSource) -> Image | None:
    picture = reader.picture() if reader.grab() else None
    return (
        None if picture is None else np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)
    )
