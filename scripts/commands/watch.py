"""`endolock watch`: vision on a recorded video, through the same interfaces as on a live one."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from endolock.scripts.commands.run import selection
from endolock.scripts.runs import output, rigs
from endolock.scripts.runs.recorded_vision import RecordedVision


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
    vision: Annotated[str, tyro.conf.arg(help=rigs.picture_vision_help())] = "markers"
    select: tyro.conf.DisallowNone[str | None] = None
    """With track: rectangle of the first picture to follow, as X,Y,WIDTH,HEIGHT [px]."""
    out: tyro.conf.DisallowNone[Path | None] = None
    """Run folder to write, with pictures and observations; new or empty."""
    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write the scores to this file as JSON; - prints only the JSON on standard output."""


def main(request: Request) -> int:
    """Carry out `endolock watch`; return the exit code."""
    output.check_json(request.json)
    task = RecordedVision(
        source=request.source,
        times=request.times,
        calibration=request.calibration,
        board=request.board,
        vision=request.vision,
        select=selection(request.select),
        out=request.out,
    )
    with Console(stderr=True).status("running vision"):
        record = task.run()
    output.write_json(asdict(record), request.json)
    if request.json != "-":
        console = Console(highlight=False)
        found = record.detected_fraction
        seen, judged = record.delayed_error_px.rms, record.vision_error_px
        console.print(
            f"{record.frames} frames, target found in {100 * (found or 0):.1f} %, "
            f"{record.vision_ms:.1f} ms per frame"
        )
        if seen is not None:
            console.print(f"distance of the target from the image centre, rms: {seen:.1f} px")
        if judged and judged.rms is not None:
            off = f"{judged.rms:.2f} px, at most {judged.max:.2f} px"
            console.print(f"distance of the target from its position by the markers, rms: {off}")
        for why, count in record.refused.items():
            console.print(f"{count:6d}  {why}", markup=False)
    return 0
