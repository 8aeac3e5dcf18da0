"""The camera of a bench: the newest picture of a video device, a stream or a video file.

OpenCV buffers up to 4 pictures of a device and a socket more, so that slow reading returns old
ones. A thread therefore reads every picture at once and keeps the last.
"""

from __future__ import annotations

import atexit
import signal
from math import inf
from pathlib import Path
from threading import Event, Lock, Thread
from typing import NamedTuple

import cv2
import numpy as np

from endolock.hw.api import Calibration, Clock, ConfigError, Frame, HardwareError, Image
from endolock.hw.camera import picture_source
from endolock.hw.camera.picture_source import PictureSource
from endolock.hw.camera.picture_source import devices as devices

FIRST_PICTURE_S = 5.0
"""Longest wait for the first picture [s]. Assumed."""
TIMEOUT_S = 10.0
"""Without a picture for this time the video is given up [s]. Assumed: longer than a stream takes to
recover from a lost link, shorter than anyone leaves an endoscope under torque unwatched."""
REOPEN_S = 1.5
"""A live source that has ended must give a picture again within this time [s]. Assumed: a run must
not stand longer than 2 s without a word."""
FAILURES = 10
"""A source has ended after this number of failed grabs in a row. Assumed."""
RETRY_S = 0.02
"""Pause after a failed grab [s]. Assumed."""
AGAIN_S = 0.1
"""Pause before a source is opened again [s]. Assumed."""
CLOSE_S = picture_source.SILENT_S + 1.0
"""Closing waits at most this time for a grab in progress [s]: it ends after `SILENT_S`."""
LOOK = "check the camera and its cable or network"
"""What to do about a source that gives no pictures."""


class Ending(NamedTuple):
    """Why no picture comes."""

    t: float
    """When that was found [s]."""
    what: str
    """The reason, for people."""
    final: bool
    """Whether no other can come, so that nothing is tried any more."""
    next_step: str
    """What to do about it."""


class VideoCamera:
    """Keeps the newest picture of a source that a thread reads continuously.

    A picture is stamped t_available = the clock's time right after its grab, and t_capture =
    t_available - latency. A source that freezes raises nothing at first: `latest` returns the last
    frame, whose age shows it. A device or stream that has ended or fallen silent is opened again
    and again; one that breaks off twice within `timeout_s` is given up. OpenCV's warnings are
    disabled for the whole process: all that matter are raised here.

    Args:
        source: a device (0 or /dev/video0), the address of a stream (http://, rtsp://) or a video
            file, which plays once at its own frame rate, starting now.
        calibration: geometry of the camera; pictures must have its size.
        clock: a wall clock; stamps the pictures.
        latency_s: capture to delivery [s], >= 0. Source: endolock latency.
        frame_rate_hz: requested from a device [Hz]; 30 if None, OpenCV's default.
        timeout_s: without a picture for this time, `latest` raises [s].

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
        timeout_s: float = TIMEOUT_S,
    ) -> None:
        self._source = str(source)
        self._calibration, self._clock = calibration, clock
        self._latency_s, self._frame_rate_hz = latency_s, frame_rate_hz
        self._timeout_s = timeout_s
        self._newest: tuple[int, float, Image] | None = None  # replaced as a whole: needs no lock
        self._frame: Frame | None = None
        self._ending: Ending | None = None  # replaced as a whole too
        self._asking = Lock()
        self._stop, self._settled = Event(), Event()
        self._refusal = (
            f"no picture came from {source} (waited up to {FIRST_PICTURE_S:g} s)",
            "switch it on, end other programs that use it, or give another source",
        )
        quiet = min(cv2.utils.logging.getLogLevel(), cv2.utils.logging.LOG_LEVEL_ERROR)
        cv2.utils.logging.setLogLevel(quiet)
        self._thread = Thread(target=self._run, name=f"video {source}", daemon=True)
        atexit.register(self._leave)
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
        """Whether no other picture can come: closed, at the end of a file, or broken off twice."""
        return not self._thread.is_alive()

    def latest(self) -> Frame | None:
        """Return the newest frame grabbed; never waits for one.

        It is `repeated` if its picture equals that of the previously returned frame, bit for bit.
        Pictures skipped between the two do not count, so that a video chain which doubles every
        picture still delivers new ones.

        Raises:
            HardwareError: the last frame has been returned before, and the source has ended or
                changed its size `REOPEN_S` ago, or gave no picture for `timeout_s`; raised again
                until a picture comes.
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
            elif newest is not None and not self._stop.is_set():
                self._check(newest[1])
            return self._frame

    def close(self) -> None:
        """Close the source; may be called twice.

        Waits for a grab in progress, which on a silent stream takes up to `CLOSE_S`.
        """
        self._stop.set()
        self._thread.join(CLOSE_S)
        if self.ended:
            atexit.unregister(self._leave)

    def _leave(self) -> None:
        """Close it as Python exits, which would abort if the thread woke up in OpenCV later."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        self.close()

    def _check(self, t: float) -> None:
        """Raise if no picture can be expected after the one at `t` [s]."""
        now, ending = self._clock.now(), self._ending
        if ending is not None and (ending.final or now - ending.t > REOPEN_S):
            what = f"the video ended: {self._source} {ending.what}"
            raise HardwareError(what, ending.next_step, t=now)
        if now - t > self._timeout_s:
            raise HardwareError(
                f"the video stopped: {self._source} gave no picture for {self._timeout_s:g} s",
                LOOK,
                t=now,
            )

    def _run(self) -> None:
        """Open, read and release the source, all in this thread: OpenCV must not be shared."""
        size = self._calibration.width, self._calibration.height
        seq, ended_at = 0, -inf
        try:
            while not self._stop.is_set():
                source = PictureSource(self._source, size, self._frame_rate_hz)
                try:
                    opened = source.opened and (source.live or source.period_s > 0)
                    if opened:
                        seq = self._drain(source, seq)
                finally:
                    source.release()
                if self._newest is None:
                    if not opened:
                        self._refusal = _unopened(self._source, source.device)
                    return
                if not opened:
                    self._miss("cannot be opened again")
                elif not source.live:
                    return
                elif self._newest[1] > ended_at:  # it came back, and has broken off again
                    before, ended_at = ended_at, self._clock.now()
                    if ended_at - before < self._timeout_s:
                        self._miss(f"broke off twice within {self._timeout_s:g} s", final=True)
                        return
                self._stop.wait(AGAIN_S)
        finally:
            self._settled.set()

    def _drain(self, source: PictureSource, seq: int) -> int:
        """Keep the newest picture until the source ends; return the number of the next one.

        A file waits a period before each picture.
        """
        width, height = self._calibration.width, self._calibration.height
        start, first, failures = self._clock.now(), seq, 0
        while self._wait_until(start + (seq - first) * source.period_s):
            asked = self._clock.now()
            good = source.grab()
            t = self._clock.now()
            if not good:
                failures += 1
                if source.live and t - asked > picture_source.SILENT_S / 2:
                    return seq  # silent; whether it is gone, opening it again will show
                if failures == FAILURES:
                    self._miss("gives no more pictures", final=not source.live)
                    return seq
                self._stop.wait(RETRY_S)
                continue
            if source.restarted():
                self._miss("began anew, perhaps in another size", final=not source.live)
                return seq
            picture, failures = source.picture(), 0
            if picture is not None and picture.shape == (height, width, 3):
                self._newest = seq, t, picture
                self._ending = None
                self._settled.set()
            elif picture is not None and self._newest is None:
                self._refusal = (
                    f"{self._source} gives pictures of {picture.shape[1]}x{picture.shape[0]} px, "
                    f"its calibration is for {width}x{height}",
                    "set it to that size, or calibrate it as it is with endolock calibrate",
                )
                return seq
            elif picture is not None:
                self._miss(
                    f"now gives pictures of {picture.shape[1]}x{picture.shape[0]} px instead of "
                    f"{width}x{height} px",
                    next_step="keep it at one size",
                )
            seq += 1
        return seq

    def _miss(self, what: str, final: bool = False, next_step: str = LOOK) -> None:
        """Note why no picture comes, unless the reason is known already."""
        if self._ending is None or (final and not self._ending.final):
            self._ending = Ending(self._clock.now(), what, final, next_step)

    def _wait_until(self, t: float) -> bool:
        """Sleep until `t` [s] in short steps; return False once it is closed."""
        while not self._stop.is_set() and (now := self._clock.now()) < t:
            self._clock.sleep_until(min(t, now + RETRY_S))
        return not self._stop.is_set()


def _unopened(source: str, device: bool) -> tuple[str, str]:
    """Return the refusal of a source that cannot be opened, and what to do."""
    if device:
        return (
            f"cannot open camera {source}; cameras here: {', '.join(devices()) or 'none'}",
            "plug it in or give another one",
        )
    return (
        f"cannot open {source} as a video",
        "give a camera such as /dev/video0, the address of a stream or a video file",
    )
