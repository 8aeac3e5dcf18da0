"""The camera of a bench: the newest picture of a video device, a stream or a video file.

OpenCV buffers up to 4 pictures of a device and a socket more, so that slow reading returns old
ones. A thread therefore reads every picture at once and keeps the last.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from math import inf
from pathlib import Path
from threading import Event, Lock, Thread

import cv2
import numpy as np

from endolock.hw.api import Calibration, Clock, ConfigError, Frame, Image

FIRST_PICTURE_S = 5.0
"""Longest wait for the first picture [s]. Assumed."""
SILENT_S = 10.0
"""A stream that sends nothing for this time has ended [s]. Source: OpenCV's time-out of devices."""
BUFFERS = 2
"""Buffers of a driver: one is filled while the other is decoded. OpenCV returns a buffer only after
decoding, so with a single one the next picture is lost. Source: OpenCV's cap_v4l.cpp."""
FAILURES = 10
"""A source has ended after this number of failed grabs in a row. Assumed."""
RETRY_S = 0.02
"""Pause after a failed grab [s]. Assumed."""
CLOSE_S = 1.0
"""Closing waits at most this time for a grab in progress [s]. Assumed."""
NAMES = Path("/sys/class/video4linux")
"""Folder in which Linux gives the names of video devices."""


class VideoCamera:
    """Keeps the newest picture of a source that a thread reads continuously.

    A picture is stamped t_available = the clock's time right after its grab, and t_capture =
    t_available - latency. A source that ends, is unplugged or freezes raises nothing: `latest`
    keeps returning the last frame, whose age shows it, and `ended` is true if no other can come.
    OpenCV's warnings are disabled for the whole process: all that matter are raised here.

    Args:
        source: a device (0 or /dev/video0), the address of a stream (http://, rtsp://) or a video
            file, which plays once at its own frame rate, starting now.
        calibration: geometry of the camera; pictures must have its size.
        clock: a wall clock; stamps the pictures.
        latency_s: capture to delivery [s], >= 0. Source: endolock latency.
        frame_rate_hz: requested from a device [Hz]; 30 if None, OpenCV's default.

    Raises:
        ConfigError: the source cannot be opened, gives no picture, or one of another size.
    """

    def __init__(
        self,
        source: int | str | Path,
        calibration: Calibration,
        clock: Clock,
        *,
        latency_s: float,
        frame_rate_hz: float | None = None,
    ) -> None:
        self._source = str(source)
        self._calibration, self._clock = calibration, clock
        self._latency_s, self._frame_rate_hz = latency_s, frame_rate_hz
        self._newest: tuple[int, float, Image] | None = None  # replaced as a whole: needs no lock
        self._frame: Frame | None = None
        self._asking = Lock()
        self._stop, self._settled = Event(), Event()
        self._refusal = (
            f"no picture came from {source} (waited up to {FIRST_PICTURE_S:g} s)",
            "switch it on, end other programs that use it, or give another source",
        )
        quiet = min(cv2.utils.logging.getLogLevel(), cv2.utils.logging.LOG_LEVEL_ERROR)
        cv2.utils.logging.setLogLevel(quiet)
        self._thread = Thread(target=self._run, name=f"video {source}", daemon=True)
        self._thread.start()
        self._settled.wait(FIRST_PICTURE_S)
        if self._newest is None:
            self.close()
            raise ConfigError(*self._refusal)

    @property
    def calibration(self) -> Calibration:
        """Its geometry."""
        return self._calibration

    @property
    def ended(self) -> bool:
        """Whether no other picture can come: closed, at the end of the file, or unplugged."""
        return not self._thread.is_alive()

    def latest(self) -> Frame | None:
        """Return the newest frame grabbed; never waits for one.

        It is `repeated` if its picture equals that of the previously returned frame, bit for bit.
        Pictures skipped between the two do not count, so that a video chain which doubles every
        picture still delivers new ones.
        """
        with self._asking:
            newest, before = self._newest, self._frame
            if newest is not None and (before is None or newest[0] != before.seq):
                seq, t, picture = newest
                image = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)
                image.flags.writeable = False
                old = before.image if before else None
                self._frame = Frame(
                    image=image,
                    t_capture=t - self._latency_s,
                    t_available=t,
                    seq=seq,
                    dropped=seq - 1 - (before.seq if before else -1),
                    repeated=old is not None and np.array_equal(image, old),
                )
            return self._frame

    def close(self) -> None:
        """Close the source; may be called twice.

        A grab that hangs is not waited for; it ends by itself within `SILENT_S`.
        """
        self._stop.set()
        self._thread.join(CLOSE_S)

    def _run(self) -> None:
        """Open, read and release the source, all in this thread: OpenCV must not be shared."""
        path = self._source
        device = path.isdecimal() or (path.startswith("/dev/") and not Path(path).is_file())
        live = device or "://" in path
        reader = self._device() if device else self._stream()
        try:
            rate_hz = inf if live else reader.get(cv2.CAP_PROP_FPS)
            if reader.isOpened() and rate_hz > 0:
                self._drain(reader, 1 / rate_hz)
            elif device:
                self._refusal = (
                    f"cannot open camera {path}; cameras here: {', '.join(devices()) or 'none'}",
                    "plug it in or give another one",
                )
            else:
                self._refusal = (
                    f"cannot open {path} as a video",
                    "give a camera such as /dev/video0, the address of a stream or a video file",
                )
        finally:
            reader.release()
            self._settled.set()

    def _device(self) -> cv2.VideoCapture:
        """Open a device and request its settings; its pictures show whether it has them."""
        api = cv2.CAP_V4L2 if sys.platform == "linux" else cv2.CAP_ANY
        if self._source.isdecimal():
            reader = cv2.VideoCapture(int(self._source), api)
        else:
            reader = cv2.VideoCapture(self._source, api)
        reader.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
        reader.set(cv2.CAP_PROP_FRAME_WIDTH, self._calibration.width)
        reader.set(cv2.CAP_PROP_FRAME_HEIGHT, self._calibration.height)
        if self._frame_rate_hz is not None:
            reader.set(cv2.CAP_PROP_FPS, self._frame_rate_hz)
        reader.set(cv2.CAP_PROP_BUFFERSIZE, BUFFERS)
        return reader

    def _stream(self) -> cv2.VideoCapture:
        """Open a stream or a file.

        One thread decodes: FFmpeg delays by one picture for each further thread, so the latency
        would depend on the computer. Eight add 280 ms at 25 Hz, measured on an MPEG-4 stream.
        """
        wait_ms = round(1e3 * SILENT_S)
        options = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, wait_ms]
        options += [cv2.CAP_PROP_READ_TIMEOUT_MSEC, wait_ms, cv2.CAP_PROP_N_THREADS, 1]
        return cv2.VideoCapture(self._source, cv2.CAP_FFMPEG, options)

    def _drain(self, reader: cv2.VideoCapture, period_s: float) -> None:
        """Keep the newest picture until the source ends; a file waits a period before each."""
        width, height = self._calibration.width, self._calibration.height
        start, seq, failures = self._clock.now(), 0, 0
        while failures < FAILURES and self._wait_until(start + seq * period_s):
            if not reader.grab():
                failures += 1
                self._stop.wait(RETRY_S)
                continue
            t, picture = self._clock.now(), _decoded(reader)
            if picture is not None and picture.shape == (height, width, 3):
                self._newest = seq, t, picture
                self._settled.set()
            elif picture is not None and self._newest is None:
                self._refusal = (
                    f"{self._source} gives pictures of {picture.shape[1]}x{picture.shape[0]} px, "
                    f"its calibration is for {width}x{height}",
                    "set it to that size, or calibrate it as it is with endolock calibrate",
                )
                return
            seq, failures = seq + 1, 0

    def _wait_until(self, t: float) -> bool:
        """Sleep until `t` [s] in short steps; return False once it is closed."""
        while not self._stop.is_set() and (now := self._clock.now()) < t:
            self._clock.sleep_until(min(t, now + RETRY_S))
        return not self._stop.is_set()


def devices(root: Path = Path("/dev")) -> list[str]:
    """List the video devices of this computer, with their names on Linux.

    A camera may have several; only the first gives pictures.
    """
    found = sorted(root.glob("video[0-9]*"), key=lambda path: (len(path.name), path.name))
    return [str(path) + _name(path.name) for path in found]


def _name(device: str) -> str:
    """Return the name of a device in brackets, or nothing."""
    with suppress(OSError, UnicodeDecodeError):
        return f" ({(NAMES / device / 'name').read_text(encoding='utf-8').strip()})"
    return ""


def _decoded(reader: cv2.VideoCapture) -> Image | None:
    """Decode the picture just grabbed, blue first; None if it is damaged."""
    with suppress(cv2.error):  # raised for an empty picture
        good, picture = reader.retrieve()
        return np.asarray(picture, np.uint8) if good else None
    return None
