"""The bench's camera, on video files, on a live stream from this computer and on a stand-in device.

Every picture shows its number: ten grey bars, each black or white, above one colour.
"""

import re
import subprocess
import sys
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

from endolock.hw.api import Camera, ConfigError, Frame, HardwareError, Image
from endolock.hw.bench.wall_clock import WallClock
from endolock.hw.camera import picture_source, video_camera
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

    def send(self, *numbers: int, size: tuple[int, int] = (WIDTH, HEIGHT)) -> None:
        """Send pictures with these numbers, as fast as they are taken."""
        for number in numbers:
            drawn = cv2.resize(_picture(number)[..., ::-1], size)
            jpeg = cv2.imencode(".jpg", drawn)[1].tobytes()
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


def test_a_stream_that_is_cut_is_reported_after_its_last_frame(stream: Stream) -> None:
    stream.send(0)
    with closing(_camera(stream.address)) as camera:
        stream.send(1)
        stream.cut()
        start = time.monotonic()
        assert _number(_last(camera, "the video ended: .* gives no more pictures; check the")) == 1
        assert time.monotonic() - start < 2.0
        with pytest.raises(HardwareError):  # and again, as long as none comes
            camera.latest()


def test_a_stream_that_is_cut_once_goes_on_where_it_comes_back(stream: Stream) -> None:
    stream.send(0)
    with closing(_camera(stream.address)) as camera:
        stream.cut()
        stream.send(1)
        assert _number(_frame(camera, 1)) == 1
        stream.send(2)
        assert _number(_frame(camera, 2)) == 2
        stream.cut()  # a second time soon after: not trusted any more
        stream.send(3)
        _last(camera, "broke off twice within 10 s")


def test_a_stream_that_falls_silent_is_reported_and_opened_again(
    stream: Stream, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(picture_source, "SILENT_S", 2.0)  # enough to open it on a busy computer
    stream.send(0)
    with closing(_camera(stream.address, timeout_s=1.0)) as camera:
        last = _last(camera, "the video stopped: .* gave no picture for 1 s; check the camera")
        assert _number(last) == 0
        stream.send(1)
        _wait(lambda: (seen := _camera_latest(camera)) is not None and _number(seen) == 1)


@pytest.mark.parametrize("size", [(160, 120), (640, 480), (HEIGHT, WIDTH)])
def test_a_stream_that_changes_its_size_is_not_believed(
    stream: Stream, size: tuple[int, int]
) -> None:
    stream.send(0)
    with closing(_camera(stream.address)) as camera:
        stream.send(1, 2)
        stream.send(3, size=size)
        stream.send(4)  # a single damaged one is skipped
        assert _number(_frame(camera, 4)) == 4
        stream.send(*range(5, 12), size=size)
        said = "now gives pictures of {}x{} px instead of 320x240 px".format(*size)
        assert _number(_last(camera, said)) == 4


def test_a_film_that_changes_its_size_is_not_believed(tmp_path: Path) -> None:
    """FFmpeg scales the second part to the first one's size; its time stamps begin anew."""
    parts = []
    for size in ((WIDTH, HEIGHT), (2 * WIDTH, HEIGHT)):
        part = tmp_path / f"{size[0]}.ts"
        writer = cv2.VideoWriter(
            str(part), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"mp4v"), 25.0, size
        )
        for number in range(10):
            writer.write(cv2.resize(_picture(number), size))
        writer.release()
        parts.append(part.read_bytes())
    film = tmp_path / "film.ts"
    film.write_bytes(b"".join(parts))
    with closing(_camera(film)) as camera:
        assert _last(camera, "began anew, perhaps in another size").seq <= 10


@pytest.mark.parametrize("closing", ["camera.close()", ""])
def test_python_exits_while_a_slow_stream_is_read(stream: Stream, closing: str) -> None:
    """It would abort if the thread woke up in OpenCV meanwhile."""
    stream.send(0)
    program = (
        "from endolock.hw.camera.video_camera import VideoCamera\n"
        "from endolock.hw.bench.wall_clock import WallClock\n"
        "from endolock.vision.camera_model import from_fovy\n"
        f"geometry = from_fovy({WIDTH}, {HEIGHT}, 85.0)\n"
        f"camera = VideoCamera({stream.address!r}, geometry, WallClock(), latency_s=0.4)\n"
        f"{closing}\n"
        "print('done', flush=True)\n"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    time.sleep(2.0)  # it has come to its end, and waits for the next picture
    stream.send(1)
    said, complaints = child.communicate(timeout=PATIENCE_S)
    assert (child.returncode, said, complaints) == (0, "done\n", "")


def test_close_may_be_called_twice(stream: Stream) -> None:
    stream.send(0)
    camera = _camera(stream.address)
    stream.send(*range(1, 5))
    for _ in range(2):
        camera.close()
        stream.send(5)  # ends a grab that waits
    _wait(lambda: camera.ended)
    assert camera.latest() is camera.latest()  # closing is no fault
    assert f"video {stream.address}" not in [thread.name for thread in threading.enumerate()]


@pytest.mark.parametrize(("name", "code"), [("film.avi", "MJPG"), ("film.mp4", "mp4v")])
def test_a_file_plays_at_its_own_rate_and_ends(tmp_path: Path, name: str, code: str) -> None:
    clock = WallClock()
    start = clock.now()
    with closing(_camera(_film(tmp_path / name, code, 10), clock)) as camera:
        seen = _until_a_fault(camera, "the video ended: .*film.* gives no more pictures")
        last = seen[-1]
        assert camera.ended
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
        assert _last(camera, "0 gives no more pictures") is frame
        assert device.released
        device.give(_picture(4))  # plugged in again
        assert _number(_frame(camera, 6)) == 4


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
    monkeypatch.setattr(picture_source, "NAMES", names)
    assert devices(tmp_path) == [
        f"{tmp_path}/video0",
        f"{tmp_path}/video2 (USB Capture: HDMI)",
        f"{tmp_path}/video10",
    ]


def _camera(
    source: int | str | Path,
    clock: WallClock | None = None,
    latency_s: float = 0.0,
    timeout_s: float = video_camera.TIMEOUT_S,
) -> VideoCamera:
    clock = clock or WallClock()
    return VideoCamera(source, CALIBRATION, clock, latency_s=latency_s, timeout_s=timeout_s)


def _latest(camera: VideoCamera) -> Frame:
    frame = camera.latest()
    assert frame is not None
    return frame


def _frame(camera: VideoCamera, seq: int) -> Frame:
    """Poll until this number of pictures has arrived."""
    _wait(lambda: _latest(camera).seq >= seq)
    return _latest(camera)


def _last(camera: VideoCamera, said: str) -> Frame:
    """Wait for a fault; return the last frame before it."""
    return _until_a_fault(camera, said)[-1]


def _until_a_fault(camera: VideoCamera, said: str) -> list[Frame]:
    """Return all frames up to a fault."""
    seen: list[Frame] = []
    faults: list[str] = []
    deadline = time.monotonic() + PATIENCE_S
    while not faults:
        assert time.monotonic() < deadline
        try:
            seen.append(_latest(camera))
        except HardwareError as error:
            faults.append(str(error))
        time.sleep(0.002)
    assert re.search(said, faults[0])
    return seen


def _camera_latest(camera: VideoCamera) -> Frame | None:
    """The newest frame; None while there is a fault."""
    with suppress(HardwareError):
        return camera.latest()
    return None


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
