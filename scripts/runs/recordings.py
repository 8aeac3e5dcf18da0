"""Recordings as frames: a run folder, or a video file with time stamps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
from pydantic import TypeAdapter

from endolock.hw import boards
from endolock.hw.api import BoardGeometry, Calibration, ConfigError, Frame
from endolock.hw.camera import camera_file, recorded_video, time_stamps
from endolock.scripts.runs import folder_contents, log_tables


class Recording(NamedTuple):
    """Frames of a recording, with camera and board."""

    frames: Iterator[Frame]
    calibration: Calibration | None
    """None if the recording has none."""
    board: BoardGeometry
    damage: list[str]
    """What is missing or damaged in a run folder."""


def open_(
    source: Path, *, times: Path | None, calibration: Path | None, board: str | None
) -> Recording:
    """Open a recording.

    Args:
        source: run folder, or video file.
        times: the time stamps of a video.
        calibration: file of the camera; required for a video, replaces that of a run folder.
        board: kind of board; default: that of the run, or the standard one.

    Raises:
        ConfigError: something is missing or cannot be read.
    """
    known = boards.all_boards()
    if board is not None and board not in known:
        raise ConfigError(f"board '{board}' is unknown", f"use {', '.join(known)}")
    geometry = known[board].geometry if board else boards.standard()
    given = camera_file.read(calibration) if calibration else None
    if source.is_dir():
        if times:
            raise ConfigError("a run folder has its own time stamps", "omit --times")
        configuration = folder_contents.configuration(source)
        if board is None:
            geometry = _plain(BoardGeometry, configuration["board"], source)
        own = _plain(Calibration, configuration["calibration"], source)
        frames = folder_contents.batches(source, "frames")
        if all(batch["tip_jpeg"].null_count == len(batch) for batch in frames):
            raise ConfigError(
                f"the run in {source} has no pictures", "run it with vision markers or track"
            )
        damage = folder_contents.damage(source, "frames")
        frames = folder_contents.batches(source, "frames")
        return Recording(_frames(frames), given or own, geometry, damage)
    if times is None:
        raise ConfigError(f"{source} needs time stamps", "give a CSV file with --times")
    return Recording(recorded_video.video(source, time_stamps.read(times)), given, geometry, [])


def _plain(kind: Any, values: Any, source: Path) -> Any:
    try:
        return TypeAdapter(kind).validate_python(values)
    except ValueError:
        raise ConfigError(
            f"{source / 'run.toml'} was written by another version", "record the run again"
        ) from None


def _frames(batches: Iterable[pa.RecordBatch]) -> Iterator[Frame]:
    for row in (row for batch in batches for row in batch.to_pylist()):
        data = row["tip_jpeg"]
        yield Frame(
            image=log_tables.decode(data) if data else None,
            t_capture=row["t_capture"],
            t_available=row["t_available"],
            seq=row["seq"],
            dropped=row["dropped"],
            repeated=row["repeated"],
        )
