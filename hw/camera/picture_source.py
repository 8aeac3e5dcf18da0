"""Pictures of a video device, a stream or a video file, one after another, through OpenCV."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

from endolock.hw.api import Image

SILENT_S = 5.0
"""Opening a stream, or waiting for its next picture, is given up after this time [s]. Assumed: a
picture every 4 s, the slowest tried, still comes through."""
BUFFERS = 2
"""Buffers of a driver: one is filled while the other is decoded. OpenCV returns a buffer only after
decoding, so with a single one the next picture is lost. Source: OpenCV's cap_v4l.cpp."""
BACKWARDS_MS = 100.0
"""A stream whose time falls by more than this has restarted [ms]. Assumed."""
NAMES = Path("/sys/class/video4linux")
"""Folder in which Linux gives the names of video devices."""


class PictureSource:
    """An opened source; all calls, the first and the last too, belong in one thread.

    OpenCV scales the pictures of a stream to the size of the first one without a word. Those of
    Motion JPEG are therefore decoded here; a stream of another code that changes its size restarts
    its time stamps, unless the change is made within one sequence, which cannot be seen from here.

    Args:
        source: number or path of a device, address of a stream, or a video file.
        size: width and height requested from a device [px].
        frame_rate_hz: requested from a device [Hz]; its default if None.
    """

    def __init__(self, source: str, size: tuple[int, int], frame_rate_hz: float | None) -> None:
        path = Path(source)
        number = source.isdecimal() and len(source) < 6
        self.device = number or (source.startswith("/dev/") and not path.is_file())
        """Whether it is a device."""
        self.live = self.device or "://" in source
        """Whether its pictures come at a pace of its own, as those of a file do not."""
        reader = _device(source, size, frame_rate_hz) if self.device else _stream(source)
        rate_hz = 0.0 if self.live else reader.get(cv2.CAP_PROP_FPS)
        self.opened = bool(reader.isOpened())
        """Whether it could be opened."""
        self.period_s = 1 / rate_hz if rate_hz > 0 else 0.0
        """Time between the pictures of a file [s]; 0 for a live source, or if it is unknown."""
        self._reader, self._newest_ms = reader, 0.0
        motion_jpeg = not self.device and reader.get(cv2.CAP_PROP_FOURCC) == _MOTION_JPEG
        self._packed = motion_jpeg and reader.set(cv2.CAP_PROP_FORMAT, -1)

    def grab(self) -> bool:
        """Wait for the next picture, at most about `SILENT_S`; return whether there is one."""
        return bool(self._reader.grab())

    def restarted(self) -> bool:
        """Return whether the stream began anew with the picture just grabbed."""
        if self.device or self._packed:
            return False
        now_ms = self._reader.get(cv2.CAP_PROP_POS_MSEC)
        fell = 0 < now_ms < self._newest_ms - BACKWARDS_MS  # 0 is unknown
        self._newest_ms = max(now_ms, self._newest_ms)
        return fell

    def picture(self) -> Image | None:
        """Decode the picture just grabbed, blue first, in its own size; None if it is damaged."""
        with suppress(cv2.error):  # raised for an empty picture
            good, data = self._reader.retrieve()
            if not good:
                return None
            if not self._packed:
                return np.asarray(data, np.uint8)
            flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
            picture = cv2.imdecode(data.ravel(), flags)
            return None if picture is None else np.asarray(picture, np.uint8)
        return None

    def release(self) -> None:
        """Close it."""
        self._reader.release()


def devices(root: Path = Path("/dev")) -> list[str]:
    """List the video devices of this computer, with their names on Linux.

    A camera may have several; only the first gives pictures.
    """
    found = sorted(root.glob("video[0-9]*"), key=lambda path: (len(path.name), path.name))
    return [str(path) + _name(path.name) for path in found]


_MOTION_JPEG = cv2.VideoWriter.fourcc(*"MJPG")


def _device(source: str, size: tuple[int, int], frame_rate_hz: float | None) -> cv2.VideoCapture:
    """Open a device and request its settings; its pictures show whether it has them."""
    api = cv2.CAP_V4L2 if sys.platform == "linux" else cv2.CAP_ANY
    if source.isdecimal():
        reader = cv2.VideoCapture(int(source), api)
    else:
        reader = cv2.VideoCapture(source, api)
    reader.set(cv2.CAP_PROP_FOURCC, _MOTION_JPEG)
    reader.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
    reader.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
    if frame_rate_hz is not None:
        reader.set(cv2.CAP_PROP_FPS, frame_rate_hz)
    reader.set(cv2.CAP_PROP_BUFFERSIZE, BUFFERS)
    return reader


def _stream(source: str) -> cv2.VideoCapture:
    """Open a stream or a file.

    One thread decodes: FFmpeg delays by one picture for each further thread, so the latency would
    depend on the computer. Eight add 280 ms at 25 Hz, measured on an MPEG-4 stream.
    """
    wait_ms = round(1e3 * SILENT_S)
    options = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, wait_ms]
    options += [cv2.CAP_PROP_READ_TIMEOUT_MSEC, wait_ms, cv2.CAP_PROP_N_THREADS, 1]
    return cv2.VideoCapture(source, cv2.CAP_FFMPEG, options)


def _name(device: str) -> str:
    """Return the name of a device in brackets, or nothing."""
    with suppress(OSError, UnicodeDecodeError):
        return f" ({(NAMES / device / 'name').read_text(encoding='utf-8').strip()})"
    return ""
