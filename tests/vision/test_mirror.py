"""A mirrored picture, in which left and right are exchanged, is never believed."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from endolock.hw import boards
from endolock.hw.api import ConfigError, Frame, Image
from endolock.scripts.runs import recorded_calibration
from endolock.twin.camera.stills import BoardPose, Studio
from endolock.twin.world import scenario
from endolock.vision import camera_model
from endolock.vision.detector import MarkerDetector
from endolock.vision.marker_eyes import MIRRORED, MarkerEyes
from endolock.vision.observation import Status
from endolock.vision.track_eyes import TrackEyes

MIRRORS: dict[str, Callable[[Image], Image]] = {
    "left-right": lambda picture: picture[:, ::-1],
    "up-down": lambda picture: picture[::-1],
    "about the diagonal": lambda picture: picture[:, ::-1][::-1].transpose(1, 0, 2),
}


@pytest.mark.parametrize("kind", boards.all_boards())
def test_no_printed_marker_decodes_in_a_mirror(kind: str) -> None:
    geometry = boards.all_boards()[kind].geometry
    ids = [marker for marker, *_ in geometry.markers]
    assert len(set(ids)) == len(ids)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, geometry.dictionary))
    for marker in ids:
        drawn = dictionary.generateImageMarker(marker, 60)
        white = np.pad(drawn, 20, constant_values=255)
        for picture in (white, white[::-1], white[:, ::-1], white[::-1, ::-1]):
            detector = cv2.aruco.ArucoDetector(dictionary)
            _, found, _ = detector.detectMarkers(np.ascontiguousarray(picture))
            upright = np.array_equal(picture, white) or np.array_equal(picture, white[::-1, ::-1])
            assert (found is not None) == upright


def test_a_marker_that_equals_its_mirror_image_is_not_used() -> None:
    """Prints of earlier versions have some; the others on them still tell."""
    board = replace(boards.standard(), markers=((8, 0.0, 0.0, 0.02), (7, 0.03, 0.0, 0.02)))
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    drawn = [dictionary.generateImageMarker(n, 60) for n in (8, 7)]
    row = np.concatenate([np.pad(one, 20, constant_values=255) for one in drawn], axis=1)
    detect = MarkerDetector(board)
    assert [marker for _, marker in detect(row)] == [7]
    markers, mirrored = detect.look(np.ascontiguousarray(row[:, ::-1]))
    assert (markers, mirrored) == ([], 1)


@pytest.mark.parametrize("kind", boards.all_boards())
def test_no_mirrored_frame_is_tracked(kind: str) -> None:
    _try_poses(kind, count=9, seed=17)


@pytest.mark.slow
@pytest.mark.parametrize("kind", boards.all_boards())
def test_no_mirrored_frame_of_many_is_tracked(kind: str) -> None:
    seed = secrets.randbelow(2**32)
    print(f"seed {seed}")
    _try_poses(kind, count=150, seed=seed)


def _try_poses(kind: str, *, count: int, seed: int) -> None:
    """Distances from 2 to 16 cm, any roll, tilts up to 40 deg: refused, and never tracked."""
    random = np.random.default_rng(seed)
    told, tracked = 0, 0
    with Studio(scenario.load("rest", {"board.kind": kind})) as studio:
        camera, board = studio.calibration, studio.board
        for _ in range(count):
            depth = float(random.uniform(0.02, 0.16))
            right, down = (depth * random.uniform(-0.5, 0.5, 2)).tolist()
            tilt, axis, roll = (random.uniform(0, top) for top in (40, 360, 360))
            pose = BoardPose((right, down, depth), tilt, axis, roll)
            frame = studio.take(pose).frame
            tracked += MarkerEyes(camera, board)(frame).status is Status.TRACKING
            for flip in MIRRORS.values():
                picture = np.ascontiguousarray(flip(_image(frame)))
                height, width, _ = picture.shape
                own = replace(camera, width=width, height=height)
                for eyes in (MarkerEyes(own, board), TrackEyes(own, board)):
                    seen = eyes(replace(frame, image=picture))
                    assert seen.status is not Status.TRACKING
                told += MIRRORED in seen.why
    assert tracked > count / 2  # most of these poses are found as they are
    assert told > 2 * tracked  # and nearly all of those are said to be mirrored, in three ways


def test_a_picture_turned_by_half_a_turn_is_not_mirrored() -> None:
    frame, eyes = _rest()
    turned = np.ascontiguousarray(_image(frame)[::-1, ::-1])
    assert eyes(replace(frame, image=turned)).status is Status.TRACKING


def test_a_selection_in_a_mirrored_picture_is_not_followed() -> None:
    frame, _ = _rest()
    track = TrackEyes(camera_model.from_fovy(640, 480, 85.0), boards.standard(), (300, 220, 40, 40))
    flipped = np.ascontiguousarray(_image(frame)[:, ::-1])
    seen = track(replace(frame, image=flipped))
    assert (seen.status, seen.why) == (Status.SEARCHING, MIRRORED)


def test_a_mirrored_recording_is_not_calibrated_from(tmp_path: Path) -> None:
    frame, _ = _rest()
    film, stamps = tmp_path / "film.avi", tmp_path / "times.csv"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (640, 480))
    for _ in range(3):
        writer.write(cv2.cvtColor(_image(frame)[::-1], cv2.COLOR_RGB2BGR))
    writer.release()
    stamps.write_text("t_capture\n0\n0.04\n0.08\n")
    with pytest.raises(ConfigError, match="is mirrored: the camera's picture is flipped"):
        recorded_calibration.calibrate(film, times=stamps)


def _rest() -> tuple[Frame, MarkerEyes]:
    with Studio(scenario.load("rest", {})) as studio:
        frame = studio.take(BoardPose((0.0, 0.0, 0.12))).frame
        return frame, MarkerEyes(studio.calibration, studio.board)


def _image(frame: Frame) -> Image:
    assert frame.image is not None
    return frame.image
