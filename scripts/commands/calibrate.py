"""`endolock calibrate`: the geometry of a camera from a recording of a board."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console

from endolock.hw.api import ConfigError
from endolock.hw.camera import camera_file
from endolock.scripts.runs import output, recordings
from endolock.vision import calibration as calibrations
from endolock.vision.detector import Marker, MarkerDetector
from endolock.vision.grey import grey_of, smoothed


@dataclass(frozen=True, kw_only=True)
class Request:
    """Calibrate a camera from pictures of a printed board, taken from several directions."""

    source: tyro.conf.Positional[Path]
    """Run folder, or video file."""
    times: tyro.conf.DisallowNone[Path | None] = None
    """CSV file with the time stamps of a video: t_capture, t_available [s]."""
    board: tyro.conf.DisallowNone[str | None] = None
    """Board: rings, tissue or several; default: that of the run, or rings."""
    projection: Literal["pinhole", "equidistant"] = "pinhole"
    """Projection of the lens; equidistant is a fisheye."""
    out: Path = Path("camera.toml")
    """File to write."""
    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Also write it to this file as JSON; - prints only the JSON on standard output."""


def main(request: Request) -> int:
    """Carry out `endolock calibrate`; return the exit code."""
    output.check_json(request.json)
    recording = recordings.open_(
        request.source, times=request.times, calibration=None, board=request.board
    )
    detect = MarkerDetector(recording.board)
    views: list[list[Marker]] = []
    size: tuple[int, int] | None = None
    err = Console(stderr=True)
    with err.status("detecting the board"):
        for frame in recording.frames:
            if frame.image is None or frame.repeated:
                continue
            height, width, _ = frame.image.shape
            if size not in (None, (width, height)):
                raise ConfigError(
                    f"pictures of {request.source} differ in size", "use pictures of one camera"
                )
            size = width, height
            views.append(detect(smoothed(grey_of(frame.image))))
    with err.status("calibrating"):
        found = calibrations.calibrate(views, recording.board, size or (0, 0), request.projection)
    camera_file.write(found, request.out)
    output.write_json(asdict(found), request.json)
    if request.json != "-":
        (u, v), distortion = found.centre_px, ", ".join(f"{c:.4g}" for c in found.distortion)
        Console(highlight=False).print(
            f"f {found.focal_px:.2f} px, aspect {found.aspect:.4f}, centre {u:.1f}, {v:.1f} px\n"
            f"distortion {distortion}\nrms {found.rms_px:.3f} px; wrote {request.out}"
        )
    return 0
