"""`endolock watch`: vision on a recorded video, through the same interfaces as on a live one."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import tyro
from rich.console import Console

from endolock.control import metrics
from endolock.control.loop import Run, Seen
from endolock.hw.api import ConfigError
from endolock.hw.camera.recorded_video import PlaybackClock, RecordedCamera
from endolock.scripts.commands.run import selection
from endolock.scripts.runs import output, recordings, run_folder
from endolock.vision.marker_eyes import MarkerEyes
from endolock.vision.observation import Eyes
from endolock.vision.track_eyes import TrackEyes


@dataclass(frozen=True, kw_only=True)
class Request:
    """Run vision on a recording: a run folder, or a video file with time stamps."""

    source: tyro.conf.Positional[Path]
    """Run folder, or video file."""
    times: tyro.conf.DisallowNone[Path | None] = None
    """CSV file with the time stamps of a video: t_capture, t_available [s]."""
    calibration: tyro.conf.DisallowNone[Path | None] = None
    """TOML file of the camera; required for a video, see endolock calibrate."""
    board: tyro.conf.DisallowNone[str | None] = None
    """Board: rings, tissue or several; default: that of the run, or rings."""
    vision: str = "markers"
    """markers: find the board in the pictures; track: follow the target without markers."""
    select: tyro.conf.DisallowNone[str | None] = None
    """With track: rectangle of the first picture to follow, as X,Y,WIDTH,HEIGHT [px]."""
    out: tyro.conf.DisallowNone[Path | None] = None
    """Run folder to write, with pictures and observations; new or empty."""
    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write the scores to this file as JSON; - prints only the JSON on standard output."""


def main(request: Request) -> int:
    """Carry out `endolock watch`; return the exit code."""
    output.check_json(request.json)
    with Console(stderr=True).status("running vision"):
        record = perform(request)
    output.write_json(record, request.json)
    if request.json != "-":
        console = Console(highlight=False)
        found = record["detected_fraction"]
        seen, judged = record["delayed_error_px"]["rms"], record["vision_error_px"]
        console.print(
            f"{record['frames']} frames, target found in {100 * (found or 0):.1f} %, "
            f"{record['vision_ms']:.1f} ms per frame"
        )
        if seen is not None:
            console.print(f"distance of the target from the image centre, rms: {seen:.1f} px")
        if judged and judged["rms"] is not None:
            off = f"{judged['rms']:.2f} px, at most {judged['max']:.2f} px"
            console.print(f"distance of the target from its position by the markers, rms: {off}")
        for why, count in record["refused"].items():
            console.print(f"{count:6d}  {why}", markup=False)
    return 0


def perform(request: Request) -> dict[str, Any]:
    """Run vision on every frame.

    Raises:
        ConfigError: the request cannot be carried out.
    """
    recording = recordings.open_(
        request.source, times=request.times, calibration=request.calibration, board=request.board
    )
    if recording.calibration is None:
        raise ConfigError("the camera is unknown", "give --calibration, see endolock calibrate")
    clock = PlaybackClock()
    camera = RecordedCamera(recording.calibration, clock, recording.frames)
    eyes = _eyes(request, recording)
    folder = None
    if request.out:
        known = {"calibration": asdict(recording.calibration), "board": asdict(recording.board)}
        folder = run_folder.RunFolder(
            request.out, {"run": {"source": str(request.source)}, **known}
        )
    run, taken = Run(), []
    refused: Counter[str] = Counter()
    try:
        while (due := camera.due) is not None:
            clock.sleep_until(due)
            frame = camera.latest()
            assert frame is not None
            start = time.perf_counter()
            observation = eyes(frame)
            taken.append(time.perf_counter() - start)
            if observation.why:
                refused[observation.why] += 1
            seen = Seen(frame=frame, observation=observation, overview=None, truth=None)
            if folder:
                folder.seen(seen)
            run.seen.append(seen.without_pictures())
    finally:
        if folder:
            folder.close()
    scores = metrics.score(run, recording.calibration, 0.0).as_dict()
    names = ("frames", "detected_fraction", "delayed_error_px", "vision_error_px")
    record = {
        **{name: scores[name] for name in names},
        "vision": request.vision,
        "vision_ms": 1e3 * median(taken) if taken else None,
        "refused": dict(refused.most_common()),
    }
    if folder:
        folder.finish(record)
    return record


def _eyes(request: Request, recording: recordings.Recording) -> Eyes:
    assert recording.calibration is not None
    selected = selection(request.select)
    if request.vision == "track":
        return TrackEyes(recording.calibration, recording.board, selected)
    if request.vision != "markers":
        raise ConfigError(f"vision '{request.vision}' is unknown here", "use markers or track")
    if selected:
        raise ConfigError("--select goes with --vision track, not with markers")
    return MarkerEyes(recording.calibration, recording.board)
