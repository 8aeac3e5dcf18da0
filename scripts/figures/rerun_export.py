"""Export of a run folder to run.rrd, a Rerun recording with its layout.

On the left the two pictures, with the image centre and the observation; on the right the section in
3-D, above the curves of error, handles and wire tensions. Pictures are shown at their delivery
time, section and board at their true time, which makes the latency visible.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from endolock.control.scores import Scores
from endolock.hw import files
from endolock.hw.api import AXES
from endolock.scripts.figures.palette import (
    RGB_BLUE,
    RGB_GREEN,
    RGB_GREY,
    RGB_ORANGE,
    RGB_RED,
    RGB_YELLOW,
)
from endolock.scripts.runs import folder_contents
from endolock.scripts.runs.markdown_table import markdown_table
from endolock.twin.world.instrument import WIRES

TIMELINE = "time"
CHUNK = 250
"""Number of rows that are converted at a time."""


def derive(folder: Path) -> Path:
    """Write run.rrd into a run folder, replacing an older one; return its path.

    Args:
        folder: a run folder, complete or cut off.

    Raises:
        ConfigError: not a run folder, or it cannot be written.
    """
    configuration = folder_contents.configuration(folder)
    path = folder / "run.rrd"
    batches = folder_contents.batches(folder, "ticks")
    signals_shown = any(any(batch["signals"].to_pylist()) for batch in batches)
    with (
        files.replacing(path, "copy the folder first") as part,
        rr.RecordingStream("endolock", recording_id=folder.resolve().name) as stream,
    ):
        stream.save(part, default_blueprint=_blueprint(signals_shown))
        _still(stream, configuration)
        _scores(stream, folder)
        centre = configuration["calibration"]["centre_px"]
        board: list[list[float]] = []
        for rows in _chunks(folder, "frames"):
            _frames(stream, rows, centre)
            board += [row["board_pose"][:3] for row in rows if row["true_t"] is not None]
        if board:
            strip = rr.LineStrips3D([np.array(board)], radii=0.0006, colors=RGB_RED)
            stream.log("world/path", strip, static=True)
        named: set[str] = set()
        for rows in _chunks(folder, "ticks"):
            _ticks(stream, rows, centre, named)
        stream.disconnect()
    return path


def _chunks(folder: Path, table: str) -> Iterator[list[dict[str, Any]]]:
    """Yield the rows of a table a few at a time; pictures of a whole one can take gigabytes."""
    rows: list[dict[str, Any]] = []
    for batch in folder_contents.batches(folder, table):
        rows += batch.to_pylist()
        if len(rows) >= CHUNK:
            yield rows
            rows = []
    if rows:
        yield rows


def _still(stream: rr.RecordingStream, configuration: dict[str, Any]) -> None:
    """Log what does not change: axes, camera geometry, centre cross, board outline, colours."""
    stream.log("world", rr.ViewCoordinates.RDF, static=True)
    c = configuration["calibration"]
    u, v = c["centre_px"]
    camera = rr.Pinhole(
        focal_length=c["focal_px"],
        principal_point=[u + 0.5, v + 0.5],  # Rerun counts from the picture's corner
        width=c["width"],
        height=c["height"],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=0.03,
    )
    stream.log("world/tip/camera", camera, static=True)
    x, y = u + 0.5, v + 0.5
    cross = [[[x - 14, y], [x + 14, y]], [[x, y - 14], [x, y + 14]]]
    stream.log("tip/centre", rr.LineStrips2D(cross, colors=RGB_GREEN, radii=1.0), static=True)
    half = configuration["board"]["size_m"] / 2
    paper = rr.Boxes3D(half_sizes=[[half, half, 0.0005]], colors=RGB_GREY, fill_mode="solid")
    stream.log("world/board", paper, static=True)
    target = rr.Points3D([[0, 0, 0]], radii=0.006, colors=RGB_RED)
    stream.log("world/board/target", target, static=True)
    colours = (RGB_ORANGE, RGB_BLUE, RGB_RED, RGB_GREEN)
    curves = {
        "error/now": ("target from centre, now [px]", RGB_RED),
        "error/seen": ("target from centre, as seen [px]", RGB_BLUE),
        **{
            f"wires/{wire}": (f"wire {wire} [N]", colour)
            for wire, colour in zip(WIRES, colours, strict=True)
        },
    }
    for axis, dark in zip(AXES, (RGB_ORANGE, RGB_BLUE), strict=True):
        curves[f"handles/{axis}/goal"] = (f"{axis} goal [deg]", RGB_GREY)
        curves[f"handles/{axis}/measured"] = (f"{axis} measured [deg]", dark)
    for path, (name, colour) in curves.items():
        stream.log(path, rr.SeriesLines(names=name, colors=colour, widths=1.5), static=True)


def _frames(stream: rr.RecordingStream, rows: list[dict[str, Any]], centre: list[float]) -> None:
    """Log pictures and observations at delivery time, section and board at their true time."""
    found = [row for row in rows if row["status"] == "tracking"]
    pixels = np.array([row["target_px"] for row in found]).reshape(-1, 2)
    error = np.hypot(*(pixels - centre).T)
    _scalars(stream, "error/seen", [row["t_available"] for row in found], error)
    delivered = [row["t_available"] for row in rows]
    for name in ("tip", "overview"):
        pictures = [(t, row[f"{name}_jpeg"]) for t, row in zip(delivered, rows, strict=True)]
        pictures = [(t, jpeg) for t, jpeg in pictures if jpeg is not None]
        if pictures:
            columns = rr.EncodedImage.columns(
                blob=[jpeg for _, jpeg in pictures], media_type=["image/jpeg"] * len(pictures)
            )
            _columns(stream, f"{name}/picture", [t for t, _ in pictures], columns)
    for t, row in zip(delivered, rows, strict=True):
        stream.set_time(TIMELINE, duration=t)
        corners = np.array(row["corners_px"] or np.empty((0, 2)), float)
        squares = [[*square, square[0]] for square in corners.reshape(-1, 4, 2) + 0.5]
        stream.log("tip/markers", rr.LineStrips2D(squares, colors=RGB_BLUE, radii=0.8))
        judged = [np.add(row["reference_px"], 0.5)] if row["reference_px"] else []
        stream.log("tip/by_markers", rr.Points2D(judged, colors=RGB_GREEN, radii=2.5))
        spot = [np.add(row["target_px"], 0.5)] if row["status"] == "tracking" else []
        stream.log("tip/target", rr.Points2D(spot, colors=RGB_YELLOW, radii=4.0))
    _true_poses(stream, [row for row in rows if row["true_t"] is not None])


def _true_poses(stream: rr.RecordingStream, rows: list[dict[str, Any]]) -> None:
    if not rows:
        return
    times = [row["true_t"] for row in rows]
    strips = [np.array(row["backbone_m"]) for row in rows]
    section = rr.LineStrips3D.columns(
        strips=strips, radii=[0.0045] * len(rows), colors=[RGB_GREY] * len(rows)
    )
    _columns(stream, "world/section", times, section)
    for entity, key in (("world/tip", "tip_pose"), ("world/board", "board_pose")):
        poses = np.array([row[key] for row in rows])
        # Rerun's quaternions are (x, y, z, w).
        turned = rr.Transform3D.columns(translation=poses[:, :3], quaternion=poses[:, [4, 5, 6, 3]])
        _columns(stream, entity, times, turned)


def _ticks(
    stream: rr.RecordingStream, rows: list[dict[str, Any]], centre: list[float], named: set[str]
) -> None:
    """Log the curves at the control rate; `named` are the signals that have a name already."""
    t = [row["t"] for row in rows]
    true = [(row["t"], row["target_px"]) for row in rows if row["target_px"] is not None]
    if true:
        error = np.hypot(*(np.array([p for _, p in true]) - centre).T)
        _scalars(stream, "error/now", [time for time, _ in true], error)
    for i, axis in enumerate(AXES):
        for key, name in (("target_rad", "goal"), ("position_rad", "measured")):
            angle = np.degrees([row[key][i] for row in rows])
            _scalars(stream, f"handles/{axis}/{name}", t, angle)
    signals = [(row["t"], dict(row["signals"] or ())) for row in rows]
    for name in dict.fromkeys(name for _, values in signals for name in values):
        curve = [(time, values[name]) for time, values in signals if name in values]
        if name not in named:
            named.add(name)
            stream.log(f"law/{name}", rr.SeriesLines(names=name.replace("_", " ")), static=True)
        _scalars(
            stream, f"law/{name}", [time for time, _ in curve], np.array([v for _, v in curve])
        )
    measured = [row for row in rows if row["tension_section_n"] is not None]
    for i, wire in enumerate(WIRES):
        force = np.array([row["tension_section_n"][i] for row in measured])
        _scalars(stream, f"wires/{wire}", [row["t"] for row in measured], force)


def _scalars(
    stream: rr.RecordingStream, path: str, times: list[float], values: NDArray[np.float64]
) -> None:
    if times:
        _columns(stream, path, times, rr.Scalars.columns(scalars=values))


def _scores(stream: rr.RecordingStream, folder: Path) -> None:
    """Log the scores of a run that has them, by the keys of metrics.json."""
    known = folder_contents.metrics(folder) or {}
    rows = []
    for field in fields(Scores):
        value = known.get(field.name)
        inner = value.items() if isinstance(value, dict) else [("", value)]
        rows += [[f"`{field.name}{key and '.' + key}`", _shown(part)] for key, part in inner]
    if known:
        text = rr.TextDocument(markdown_table(["score", "value"], rows), media_type="text/markdown")
        stream.log("scores", text, static=True)


def _shown(value: Any) -> str:
    """Write a score as text, with three digits."""
    if isinstance(value, list):
        return ", ".join(map(_shown, value))
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _columns(stream: rr.RecordingStream, path: str, times: list[float], columns: Any) -> None:
    index = rr.TimeColumn(TIMELINE, duration=times)
    rr.send_columns(path, indexes=[index], columns=columns, recording=stream)


def _blueprint(signals_shown: bool) -> rrb.Blueprint:
    pictures = rrb.Vertical(
        rrb.Spatial2DView(origin="tip", name="tip camera, as delivered"),
        rrb.Tabs(
            rrb.Spatial2DView(origin="overview", name="fixed camera"),
            rrb.TextDocumentView(origin="scores", name="scores"),
        ),
    )
    curves = rrb.Vertical(
        rrb.Spatial3DView(origin="world", name="section and board"),
        rrb.TimeSeriesView(origin="error", name="error [px]"),
        rrb.TimeSeriesView(origin="handles", name="handles [deg]"),
        rrb.TimeSeriesView(origin="wires", name="wire tension at the section [N]"),
        *(
            [rrb.TimeSeriesView(origin="law", name="signals of the controller")]
            if signals_shown
            else []
        ),
        row_shares=[3, 2, 2, 2, *([2] if signals_shown else [])],
    )
    return rrb.Blueprint(
        rrb.Horizontal(pictures, curves, column_shares=[2, 3]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
    )
