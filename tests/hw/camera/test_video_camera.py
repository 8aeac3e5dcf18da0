"""The bench's camera, on video files, on a live stream from this computer and on a stand-in device.

Every picture shows its number: ten grey bars, each black or white, above one colour.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from queue import Queue
from typing import Self

import cv2
import numpy as np
import pytest

from endolock.hw.api import Camera, ConfigError, Frame, Image
from endolock.hw.bench.wall_clock import WallClock
from endolock.hw.camera import video_camera
from endolock.hw.camera.video_camera import VideoCamera, devices
from endolock.vision import camera_model

pytestmark = pytest.mark.wall_time

WIDTH, HEIGHT, BITS = 320, 240, 10
CALIBRATION = camera_model.from_fovy(WIDTH, HEIGHT, 85.0)
COLOUR = (200, 60, 30)
PATIENCE_S = 20.0
"""Time limit of a test [s]: the computer may be busy."""


class Stream:
    """A network camera: sends given pictures to one client."""

    def __init__(self) -> None:
        parts: Queue[bytes | None] = Queue()

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=next")
                self.end_headers()
                with suppress(OSError):  # the camera was closed
                    while (part := parts.get()) is not None:
                        self.wfile.write(part)

            def log_message(self, format: str, *args: object) -> None:
                pass

        self._parts = parts
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.address = f"http://127.0.0.1:{self._server.server_port}/video.mjpg"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.01,))
        self._thread.start()

    def send(self, *numbers: int) -> None:
        """Send pictures with these numbers, as fast as they are taken."""
        for number in numbers:
            jpeg = cv2.imencode(".jpg", _picture(number)[..., ::-1])[1].tobytes()
            head = f"--next\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
            self._parts.put(head.encode() + jpeg + b"\r\n")

    def cut(self) -> None:
        """Hang up after what was sent."""
        self._parts.put(None)

    def close(self) -> None:
        """Hang up and stop listening."""
        self.cut()
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


class Device:
    """Stands in for OpenCV's reader of a device: shows picture 0, then what it is given."""

    def __init__(self) -> None:
        self.opened: object = None
        self.asked: dict[int, float] = {}
        self.released = False
        self._things: Queue[Image | str] = Queue()
        self._given = self._grabs = 0
        self._grabbed: Image | str = "lost"
        self.give(_picture(0), wait=False)

    def __call__(self, source: object, _api: object) -> Self:
        """Open it, in the place of `cv2.VideoCapture`."""
        self.opened = source
        return self

    def give(self, *things: Image | str, wait: bool = True) -> None:
        """Give pictures, or "lost" or "damaged" ones, and wait until they were dealt with."""
        for thing in things:
            self._things.put(thing)
        self._given += len(things)
        if wait:
            _wait(lambda: self._grabs > self._given)

    def isOpened(self) -> bool:
        """It always is."""
        return True

    def set(self, key: int, value: float) -> bool:
        """Remember what is asked for."""
        self.asked[key] = value
        return True

    def grab(self) -> bool:
        """Wait for the next thing."""
        self._grabs += 1
        self._grabbed = self._things.get()
        return not isinstance(self._grabbed, str) or self._grabbed != "lost"

    def retrieve(self) -> tuple[bool, Image]:
        """Decode it."""
        if isinstance(self._grabbed, str):
            raise cv2.error("no data")
        return True, self._grabbed[..., ::-1].copy()

    def release(self) -> None:
        """Release it."""
        self.released = True


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        video_camera, "CLOSE_S", 0.1
    )  # many tests close a camera that waits for pictures


@pytest.fixture
def stream() -> Iterator[Stream]:
    with closing(Stream()) as source:
        yield source


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> Iterator[Device]:
    source = Device()
    monkeypatch.setattr(cv2, "VideoCapture", source)
    yield source
    source.give("lost", wait=False)  # lets go of a thread that waits


def test_a_live_stream_delivers_its_newest_picture(stream: Stream) -> None:
    stream.send(0)
    with closing(_camera(stream.address)) as camera:
        checked: Camera = camera  # the type checker compares it with the protocol
        assert checked.calibration is CALIBRATION
        frames = [_latest(camera)]
        assert _number(frames[0]) == 0
        stream.send(*range(1, 200))
        while _number(frames[-1]) != 199:  # ends only if the newest one is found
            time.sleep(0.2)
            frames.append(_latest(camera))
        assert len({frame.seq for frame in frames}) < 100  # and not all of them, one by one
        assert not camera.ended
    image = frames[-1].image
    assert image is not None
    # JPEG keeps an even colour to a few levels; red and blue are not exchanged
    assert np.abs(image[-10, 10].astype(int) - COLOUR).max() < 12
    assert not image.flags.writeable  # others may be looking at it


def test_stamps_lie_between_sending_and_asking(stream: Stream) -> None:
    clock = WallClock()
    stream.send(0)
    with closing(_camera(stream.address, clock, latency_s=0.4)) as camera:
        before = _latest(camera)
        for number in range(1, 30):
            sent = clock.now()
            stream.send(number)
            frame = _frame(camera, number)
            assert sent < frame.t_available < clock.now()
            assert frame.t_capture == frame.t_available - 0.4
            assert (frame.seq, frame.dropped) == (before.seq + 1, 0)
            before = frame


def test_dropped_counts_overtaken_frames(device: Device) -> None:
    with closing(_camera("0")) as camera:
        device.give(_picture(1), _picture(2))
        frames = [_latest(camera)]
        device.give(_picture(3))
        frames.append(_latest(camera))
        assert camera.latest() is frames[-1]  # the same one, not counted again
        device.give(*map(_picture, range(4, 10)))
        frames.append(_latest(camera))
    assert [(frame.seq, frame.dropped) for frame in frames] == [(2, 2), (3, 0), (9, 5)]
    assert sum(frame.dropped for frame in frames) == 10 - len(frames)


def test_frames_of_a_frozen_stream_are_marked_repeated(stream: Stream) -> None:
    stream.send(5)
    with closing(_camera(stream.address)) as camera:
        assert not _latest(camera).repeated
        for seq, (number, repeated) in enumerate([(5, True), (5, True), (6, False)], 1):
            stream.send(number)
            frame = _frame(camera, seq)
            assert (_number(frame), frame.repeated) == (number, repeated)
            assert camera.latest() is frame  # asking again changes nothing


def test_a_source_that_sends_every_picture_twice_gives_new_frames(device: Device) -> None:
    with closing(_camera("0")) as camera:
        for number in range(1, 4):
            device.give(_picture(number), _picture(number))
            frame = _latest(camera)
            assert (_number(frame), frame.repeated) == (number, False)


def test_a_stream_that_is_cut_ends_with_its_last_frame(stream: Stream) -> None:
    stream.send(0)
    with closing(_camera(stream.address)) as camera:
        stream.send(1)
        stream.cut()
        assert _number(_last(camera)) == 1


def test_a_stream_that_falls_silent_ends(stream: Stream, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video_camera, "SILENT_S", 2.0)  # enough to open it on a busy computer
    stream.send(0)
    with closing(_camera(stream.address)) as camera:
        assert _number(_last(camera)) == 0


def test_close_may_be_called_twice(stream: Stream) -> None:
    stream.send(0)
    camera = _camera(stream.address)
    stream.send(*range(1, 5))
    for _ in range(2):
        camera.close()
        stream.send(5)  # ends a grab that waits
    assert _last(camera) is camera.latest()
    assert f"video {stream.address}" not in [thread.name for thread in threading.enumerate()]


@pytest.mark.parametrize(("name", "code"), [("film.avi", "MJPG"), ("film.mp4", "mp4v")])
def test_a_file_plays_at_its_own_rate_and_ends(tmp_path: Path, name: str, code: str) -> None:
    clock = WallClock()
    start = clock.now()
    with closing(_camera(_film(tmp_path / name, code, 10), clock)) as camera:
        seen = [_latest(camera)]
        while not camera.ended:
            time.sleep(0.005)
            seen.append(_latest(camera))
        last = _latest(camera)
    assert [_number(frame) for frame in seen] == [frame.seq for frame in seen]
    assert (last.seq, _number(last)) == (9, 9)
    for frame in (*seen, last):
        assert frame.t_available >= start + frame.seq / 25.0  # never early, at 25 Hz


def test_the_settings_are_requested_from_a_device(device: Device) -> None:
    clock = WallClock()
    with closing(VideoCamera("/dev/video3", CALIBRATION, clock, latency_s=0, frame_rate_hz=50)):
        assert device.opened == "/dev/video3"
        assert device.asked == {
            cv2.CAP_PROP_FOURCC: cv2.VideoWriter.fourcc(*"MJPG"),
            cv2.CAP_PROP_FRAME_WIDTH: WIDTH,
            cv2.CAP_PROP_FRAME_HEIGHT: HEIGHT,
            cv2.CAP_PROP_FPS: 50,
            cv2.CAP_PROP_BUFFERSIZE: 2,
        }


def test_an_occasional_read_error_is_tolerated(device: Device) -> None:
    with closing(_camera(0)) as camera:
        assert device.opened == 0
        for number in (1, 2):
            device.give(*["lost"] * (video_camera.FAILURES - 1), _picture(number))
            assert _number(_latest(camera)) == number
        small = np.zeros((2, 2, 3), np.uint8)
        device.give("damaged", small)
        assert _latest(camera).seq == 2  # neither is shown
        device.give(_picture(3))
        frame = _latest(camera)
        assert (_number(frame), frame.seq, frame.dropped) == (3, 5, 2)  # but both are counted
        assert not camera.ended
        device.give(*["lost"] * (video_camera.FAILURES - 1))
        device.give("lost", wait=False)
        assert _last(camera) is frame
    assert device.released


def test_pictures_of_another_size_are_refused(tmp_path: Path) -> None:
    path = _film(tmp_path / "film.avi", "MJPG", 2)
    with pytest.raises(ConfigError) as caught:
        VideoCamera(path, camera_model.from_fovy(1280, 720, 85.0), WallClock(), latency_s=0.0)
    assert str(caught.value) == (
        f"{path} gives pictures of 320x240 px, its calibration is for 1280x720; set it to that "
        "size, or calibrate it as it is with endolock calibrate"
    )


def test_a_file_that_is_not_a_video_is_refused(tmp_path: Path, stream: Stream) -> None:
    text = tmp_path / "film.avi"
    text.write_text("no video at all")
    stream.close()
    for source in (text, tmp_path / "missing.avi", tmp_path, stream.address):
        with pytest.raises(ConfigError) as caught:
            _camera(source)
        assert str(caught.value) == (
            f"cannot open {source} as a video; give a camera such as /dev/video0, the address of "
            "a stream or a video file"
        )


def test_a_missing_camera_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for here, listed in (([], "none"), (["/dev/video0 (A)", "/dev/b"], "/dev/video0 (A), /dev/b")):
        monkeypatch.setattr(video_camera, "devices", lambda here=here: here)
        with pytest.raises(ConfigError) as caught:
            _camera("/dev/null")
        assert str(caught.value) == (
            f"cannot open camera /dev/null; cameras here: {listed}; plug it in or give another one"
        )


def test_a_source_without_pictures_is_refused(
    stream: Stream, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(video_camera, "FIRST_PICTURE_S", 0.5)
    empty = _film(tmp_path / "film.avi", "MJPG", 1)
    empty.write_bytes(empty.read_bytes().replace(b"\xff\xd8", b"\x00\x00"))  # no picture begins
    for source in (stream.address, empty):
        with pytest.raises(ConfigError) as caught:
            _camera(source)
        assert str(caught.value) == (
            f"no picture came from {source} (waited up to 0.5 s); switch it on, end other "
            "programs that use it, or give another source"
        )


def test_devices_are_listed_with_their_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("video10", "video2", "video0", "videoX", "null"):
        (tmp_path / name).touch()
    names = tmp_path / "names"
    (names / "video2").mkdir(parents=True)
    (names / "video2" / "name").write_text("USB Capture: HDMI\n")
    monkeypatch.setattr(video_camera, "NAMES", names)
    assert devices(tmp_path) == [
        f"{tmp_path}/video0",
        f"{tmp_path}/video2 (USB Capture: HDMI)",
        f"{tmp_path}/video10",
    ]


def _camera(
    source: int | str | Path, clock: WallClock | None = None, latency_s: float = 0.0
) -> VideoCamera:
    return VideoCamera(source, CALIBRATION, clock or WallClock(), latency_s=latency_s)


def _latest(camera: VideoCamera) -> Frame:
    frame = camera.latest()
    assert frame is not None
    return frame


def _frame(camera: VideoCamera, seq: int) -> Frame:
    """Poll until this number of pictures has arrived."""
    _wait(lambda: _latest(camera).seq >= seq)
    return _latest(camera)


def _last(camera: VideoCamera) -> Frame:
    """Wait for the end."""
    _wait(lambda: camera.ended)
    return _latest(camera)


def _wait(true: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.002)


def _picture(number: int) -> Image:
    """A picture that shows a number, RGB."""
    picture = np.full((HEIGHT, WIDTH, 3), COLOUR, np.uint8)
    bits = [255 * (number >> bit & 1) for bit in range(BITS)]
    picture[: HEIGHT // 2] = np.repeat(bits, WIDTH // BITS)[:, None]
    return picture


def _number(frame: Frame) -> int:
    """What number a picture shows."""
    assert frame.image is not None
    step = WIDTH // BITS
    bars = frame.image[HEIGHT // 4, step // 2 :: step, 1]
    return sum(1 << bit for bit in range(BITS) if bars[bit] > 127)


def _film(path: Path, code: str, count: int) -> Path:
    """Write a video of this number of numbered pictures, 25 Hz."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), 25.0, (WIDTH, HEIGHT))
    assert writer.isOpened()
    for number in range(count):
        writer.write(cv2.cvtColor(_picture(number), cv2.COLOR_RGB2BGR))
    writer.release()
    return path
