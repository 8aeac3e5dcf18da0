"""Recorded video as a camera: delivered by its time stamps, damaged or not."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from endolock.hw.api import Camera, Clock, ConfigError, Frame
from endolock.hw.camera.recorded_video import PlaybackClock, RecordedCamera, video
from endolock.vision import camera_model

CALIBRATION = camera_model.from_fovy(64, 48, 85.0)


def test_it_is_a_camera_with_a_clock() -> None:
    clock: Clock = PlaybackClock()  # the type checker compares both with the protocols
    camera: Camera = RecordedCamera(CALIBRATION, PlaybackClock(), [])
    assert camera.latest() is None
    assert not clock.realtime


def test_frames_are_delivered_at_their_recorded_times() -> None:
    clock = PlaybackClock()
    frames = [_frame(seq, 0.4 + 0.04 * seq) for seq in range(5)]
    camera = RecordedCamera(CALIBRATION, clock, frames)
    seen: list[int] = []
    while (due := camera.due) is not None:
        clock.sleep_until(due - 0.001)
        before = camera.latest()
        assert (before.seq if before else -1) == len(seen) - 1
        clock.sleep_until(due)
        newest = camera.latest()
        assert newest is not None
        seen.append(newest.seq)
    assert seen == [0, 1, 2, 3, 4]
    assert clock.sleep_until(0.0) == pytest.approx(0.56)  # it does not go back


def test_a_video_is_read_with_its_stamps(tmp_path: Path) -> None:
    path, pictures = _video(tmp_path)
    stamps = [(0.1 * n, 0.1 * n + 0.3) for n in range(len(pictures))]
    frames = list(video(path, stamps))
    assert [(f.t_capture, f.t_available, f.seq) for f in frames] == [
        (*stamp, seq) for seq, stamp in enumerate(stamps)
    ]
    for frame, picture in zip(frames, pictures, strict=True):
        assert frame.image is not None
        # MJPG keeps even colours to a few levels; red and blue are not exchanged
        assert np.abs(frame.image.astype(int) - picture).max() < 12


def test_identical_pictures_are_marked_repeated(tmp_path: Path) -> None:
    path, pictures = _video(tmp_path, repeat=2)
    frames = list(video(path, [(0.1 * n, 0.1 * n) for n in range(len(pictures))]))
    assert [f.repeated for f in frames] == [n % 2 == 1 for n in range(len(pictures))]


def test_a_video_that_ends_early_gives_frames_without_pictures(tmp_path: Path) -> None:
    path, pictures = _video(tmp_path)
    stamps = [(0.1 * n, 0.1 * n) for n in range(len(pictures) + 2)]
    frames = list(video(path, stamps))
    assert [f.image is None for f in frames] == [False] * len(pictures) + [True] * 2


def test_a_damaged_video_gives_one_line_or_frames_without_pictures(tmp_path: Path) -> None:
    path, pictures = _video(tmp_path, repeat=20)
    data = path.read_bytes()
    stamps = [(0.1 * n, 0.1 * n) for n in range(len(pictures))]
    for part in (0.3, 0.6, 0.9):
        path.write_bytes(data[: int(len(data) * part)])
        try:
            frames = list(video(path, stamps))
        except ConfigError as error:
            assert "as a video" in str(error) or "holds no picture" in str(error)  # noqa: PT017
        else:
            assert len(frames) == len(stamps)
            assert frames[-1].image is None


def test_unreadable_files_give_one_line(tmp_path: Path) -> None:
    path, _ = _video(tmp_path)
    with pytest.raises(ConfigError, match="more than the 2 frames that have time stamps"):
        list(video(path, [(0.0, 0.0), (0.1, 0.1)]))
    (tmp_path / "none.avi").write_bytes(b"no video at all")
    for name in ("none.avi", "missing.avi"):
        with pytest.raises(ConfigError, match=r"cannot open|holds no picture"):
            list(video(tmp_path / name, [(0.0, 0.0)]))


def test_a_recording_that_changes_its_size_keeps_the_true_sizes(tmp_path: Path) -> None:
    path, _ = _video(tmp_path)
    other, _ = _video(tmp_path, size=(32, 24), name="small.avi")
    data, small = path.read_bytes(), other.read_bytes()
    # The last picture of the film is replaced by a smaller one, which is a shorter chunk.
    start, own = data.rindex(b"\xff\xd8"), small[small.index(b"\xff\xd8") :]
    end = own.index(b"\xff\xd9") + 2
    path.write_bytes(data[:start] + own[:end] + data[start + end :])
    frames = list(video(path, [(0.1 * n, 0.1 * n) for n in range(4)]))
    assert [f.image.shape for f in frames if f.image is not None][-1] == (24, 32, 3)


def _video(
    folder: Path, repeat: int = 1, size: tuple[int, int] = (64, 48), name: str = "film.avi"
) -> tuple[Path, list[np.ndarray]]:
    """A film of even colours, each shown `repeat` times."""
    colours = [(200, 40, 30), (30, 180, 60), (40, 60, 210), (180, 180, 30)]
    shape = (size[1], size[0], 3)
    pictures = [np.full(shape, colour, np.uint8) for colour in colours for _ in range(repeat)]
    path = folder / name
    fourcc = cv2.VideoWriter.fourcc(*"MJPG")
    writer = cv2.VideoWriter(str(path), fourcc, 25.0, size)
    assert writer.isOpened()
    for picture in pictures:
        writer.write(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    writer.release()
    return path, pictures


def _frame(seq: int, t: float) -> Frame:
    return Frame(image=None, t_capture=t - 0.4, t_available=t, seq=seq, dropped=0)
