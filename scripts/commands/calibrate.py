"""`endolock calibrate`: the geometry of a camera from a recording of a board."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console

from endolock.hw.camera import camera_file
from endolock.scripts.runs import folder_contents, output, recorded_calibration


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
    with Console(stderr=True).status("detecting the board") as status:
        found = recorded_calibration.calibrate(
            request.source,
            times=request.times,
            board=request.board,
            projection=request.projection,
            progress=status.update,
        )
    camera_file.write(found, request.out)
    is_run = request.source.is_dir()
    damage = folder_contents.damage(request.source, "frames") if is_run else []
    output.write_json({**asdict(found), "damage": damage}, request.json)
    if request.json != "-":
        (u, v), distortion = found.centre_px, ", ".join(f"{c:.4g}" for c in found.distortion)
        Console(highlight=False).print(
            f"f {found.focal_px:.2f} px, aspect {found.aspect:.4f}, centre {u:.1f}, {v:.1f} px\n"
            f"distortion {distortion}\nrms {found.rms_px:.3f} px; wrote {request.out}"
        )
    return 0
