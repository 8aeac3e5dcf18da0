"""`endolock hysteresis`: lost motion between handle and tip, at several bends."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import degrees
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich import box
from rich.console import Console
from rich.table import Table

from endolock.scripts.commands.run import INSTRUMENT
from endolock.scripts.runs import output, rigs
from endolock.scripts.runs.hysteresis_measurement import HysteresisMeasurement
from endolock.scripts.runs.hysteresis_widths import BENDS_DEG
from endolock.twin.world.scenario_sections import PoseTrackerSettings


@dataclass(frozen=True, kw_only=True)
class Request:
    """Measure the hysteresis of one axis with slow strokes and a pose tracker."""

    axis: Literal["up_down", "left_right"] = "up_down"
    """Handle that turns."""
    other_axis_deg: float = 0.0
    """Bend of the other axis, reached first and held [deg]."""
    shaft_deg: float = 180.0
    """Bend of the shaft [deg]."""
    instrument: Annotated[str, tyro.conf.arg(help=INSTRUMENT)] = "pretensioned"
    numerics: Literal["default", "fast", "fidelity"] = "default"
    """Numerics of the simulation."""
    rig: Annotated[str, tyro.conf.arg(help=rigs.tracked_rig_help())] = "twin"
    noise_deg: float = PoseTrackerSettings().rotation_noise_deg
    """Noise of the pose tracker about each axis, standard deviation [deg]."""
    map: bool = False
    """Also measure the width over own and other bend, and over the bend of the shaft."""
    seed: int = 0
    """Seed of the tracker's noise."""
    out: tyro.conf.DisallowNone[Path | None] = None
    """Folder for the log (readable by endolock identify), the figures and hysteresis.png; new or
    empty. Without it nothing is written."""
    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write the figures to this file as JSON; - prints only the JSON on standard output."""


def main(request: Request) -> int:
    """Carry out `endolock hysteresis`; return the exit code."""
    output.check_json(request.json)
    console = Console(stderr=request.json == "-")
    values = {field.name: getattr(request, field.name) for field in fields(HysteresisMeasurement)}
    measurement = HysteresisMeasurement(**values)
    output.say(measurement.notes)
    record = measurement.run(show_progress=True)
    if request.out:
        from endolock.scripts.figures import hysteresis_figure  # loads Matplotlib

        with console.status("drawing hysteresis.png"):
            hysteresis_figure.draw(record, request.out / "hysteresis.png")
        output.write_json(record, str(request.out / "hysteresis.json"))
    output.write_json(record, request.json)
    if request.json != "-":
        console.print(table(record))
        if request.out:
            console.print(f"folder: {request.out}", soft_wrap=True, highlight=False, markup=False)
    return 0


def table(record: dict[str, Any]) -> Table:
    """Format a record as a table."""
    title = (
        f"{record['axis']}, shaft at {record['shaft_deg']:g} deg, other axis at "
        f"{record['other_axis_deg']:.0f} deg; handle motion lost, of 180 deg"
    )
    result = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 2, 0, 0))
    result.add_column("bend")
    for heading in BENDS_DEG:
        result.add_column(f"{heading} deg", justify="right")
    result.add_row("full loop", *map(_cell, record["width"].values()))
    for side, strokes in record["strokes"].items():
        back, out = strokes["back"].values(), strokes["out"].values()
        result.add_row(f"{side} stroke to there, after the turn", "", *map(_cell, back))
        result.add_row("... and after the turn at zero before it", "", *map(_cell, out))
    result.caption = (
        f"deadband {record['deadband_rad']:.3f} rad, largest bend {record['max_bend_deg']:.0f} deg "
        f"at {degrees(record['crest_rad']):.0f} deg of handle, drift "
        f"{record['drift_deg_per_min']:.2f} deg/min; -: not passed"
    )
    result.caption_justify = "left"
    return result


def _cell(share: float | None) -> str:
    return "-" if share is None else f"{share:.3f}"
