"""`endolock hysteresis`: lost motion between handle and tip, at several bends."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace
from math import degrees, pi, radians
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich import box
from rich.console import Console
from rich.progress import track
from rich.table import Table

from endolock.control.identification.hysteresis_loop import Branch, deadband, lost_after_turn, width
from endolock.hw.api import AXES, ConfigError
from endolock.scripts.runs import output, rigs, run_folder
from endolock.scripts.runs.hysteresis_protocol import (
    SPEED_RAD_S,
    TURNS_DEG,
    Protocol,
    RecordedStrokes,
)
from endolock.scripts.runs.progress import progress
from endolock.twin.world import instrument_files
from endolock.twin.world import scenario as scenarios
from endolock.twin.world.scenario import Scenario
from endolock.twin.world.scenario_sections import PoseTrackerSettings

BENDS_DEG = (0, 30, 60, 90)
"""Bends at which widths are reported."""
MAP_OWN_DEG = tuple(range(0, 91, 10))
MAP_OTHER_DEG = (0, 15, 30, 45, 60, 75)
MAP_SHAFT_DEG = tuple(range(0, 361, 45))
LOOP_POINTS = 400
"""Number of points of the loop in the JSON, about."""
USUAL_CREST_RAD = 2.8
"""Usual handle angle of the crests [rad], for the progress bar."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Measure the hysteresis of one axis with slow strokes and a pose tracker."""

    axis: Literal["up_down", "left_right"] = "up_down"
    """Handle that turns."""
    other_axis_deg: float = 0.0
    """Bend of the other axis, reached first and held [deg]."""
    shaft_deg: float = 180.0
    """Bend of the shaft [deg]."""
    instrument: str = "pretensioned"
    """Instrument: pretensioned, slack, two_region, thesis, or a TOML file of that form."""
    numerics: Literal["default", "fast", "fidelity"] = "default"
    """Numerics of the simulation."""
    rig: str = "twin"
    """Rig to drive: twin, hil or hil:wall."""
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
    record = perform(request)
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


def scenario_for(shaft_deg: float, noise_deg: float) -> Scenario:
    """Return the scenario `rest` with a bent shaft and a pose tracker.

    Raises:
        ConfigError: a value is out of range.
    """
    watched = {
        "shaft_bend_deg": shaft_deg,
        "tracker.rotation_noise_deg": noise_deg,
    }
    return scenarios.load("rest", watched)


def perform(request: Request, *, show_progress: bool = True) -> dict[str, Any]:
    """Run the protocol and compute its figures; with `out`, write a run folder.

    Args:
        request: what to measure.
        show_progress: whether to show a progress bar.

    Returns:
        The record: width, deadband_rad, max_bend_deg, drift_deg_per_min, loop, and further figures.

    Raises:
        ConfigError: the request cannot be carried out; nothing was written.
        HardwareError: the handles stopped.
    """
    start = time.perf_counter()
    strokes, other_axis_rad, simulated_s = _strokes(request, show_progress)
    record: dict[str, Any] = {
        **figures(strokes),
        "axis": request.axis,
        "other_axis_deg": degrees(other_axis_rad),
        "shaft_deg": request.shaft_deg,
        "instrument": request.instrument,
        "numerics": request.numerics,
        "noise_deg": request.noise_deg,
        "seed": request.seed,
    }
    if request.map:
        record |= _maps(request, show_progress)
    record["simulated_s"] = simulated_s
    record["wall_s"] = time.perf_counter() - start
    return record


def figures(strokes: RecordedStrokes) -> dict[str, Any]:
    """Compute the figures of recorded strokes; widths are fractions of 180 deg of handle angle."""
    falling, rising = strokes.loop
    handle = [*falling.handle, *rising.handle]
    bend = [*falling.bend, *rising.bend]
    every = max(1, len(handle) // LOOP_POINTS)
    points = list(zip(handle, bend, strict=True))[::every]
    one_sided = {}
    for side, turns in strokes.one_sided.items():
        pairs = {str(turn): turns.get(turn) for turn in sorted(TURNS_DEG)}
        one_sided[side] = {
            "out": {turn: _lost(pair[0]) if pair else None for turn, pair in pairs.items()},
            "back": {turn: _lost(pair[1]) if pair else None for turn, pair in pairs.items()},
        }
    return {
        "width": {str(d): _width(strokes, d) for d in BENDS_DEG},
        "strokes": one_sided,
        "deadband_rad": _deadband(strokes),
        "max_bend_deg": degrees(max(bend)),
        "drift_deg_per_min": strokes.drift_deg_per_min,
        "crest_rad": strokes.reached_rad,
        "loop": [[round(float(h), 6), round(float(b), 6)] for h, b in points],
    }


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


def _strokes(
    request: Request, show_progress: bool, *, whole: bool = True
) -> tuple[RecordedStrokes, float, float]:
    """Run the protocol once; return strokes, bend of the other axis [rad] and duration [s]."""
    if request.rig.startswith(rigs.SERIAL):
        raise ConfigError(
            "a bench has no pose tracker",
            "use --rig twin or hil, or log strokes as a CSV file for endolock identify",
        )
    rig, _ = rigs.make(
        request.rig,
        scenario_for(request.shaft_deg, request.noise_deg),
        vision="truth",
        instrument=instrument_files.load(request.instrument),
        numerics=request.numerics,
        seed=request.seed,
    )
    quarters = 15.0 if whole else 5.0
    expected_s = quarters * USUAL_CREST_RAD / SPEED_RAD_S + (32.0 if whole else 0.0)
    with rig, progress("strokes", round(expected_s), show_progress) as report:
        protocol = Protocol(rig, AXES.index(request.axis), report)
        other_axis_rad = protocol.bend_other_axis(radians(request.other_axis_deg))
        folder = None
        if request.out and whole:
            configuration = {"hysteresis": _plain(request), **rig.describe()}
            folder = run_folder.RunFolder(request.out, configuration)
        try:
            strokes = protocol.run(folder, whole=whole)
        finally:
            if folder:
                folder.close()
        return strokes, other_axis_rad, rig.clock.now()


def _maps(request: Request, show_progress: bool) -> dict[str, Any]:
    """Measure the width over own and other bend, and at 30 deg over the bend of the shaft."""
    others = [replace(request, other_axis_deg=float(deg)) for deg in MAP_OTHER_DEG]
    shafts = [replace(request, shaft_deg=float(d), other_axis_deg=0.0) for d in MAP_SHAFT_DEG]
    loops: list[RecordedStrokes | None] = []
    bar = track(
        others + shafts,
        "a loop for each point of the maps",
        console=Console(stderr=True),
        disable=not show_progress,
    )
    for point in bar:
        try:
            loops.append(_strokes(point, False, whole=False)[0])
        except ConfigError:  # the other axis does not reach this bend: no figures for this row
            loops.append(None)
    beside, bent = loops[: len(others)], loops[len(others) :]
    return {
        "map": {
            "own_deg": list(MAP_OWN_DEG),
            "other_deg": list(MAP_OTHER_DEG),
            "width": [
                [_width(loop, own) if loop else None for own in MAP_OWN_DEG] for loop in beside
            ],
        },
        "shaft_map": {
            "shaft_deg": list(MAP_SHAFT_DEG),
            "width_at_30": [_width(loop, 30) if loop else None for loop in bent],
            "deadband_rad": [_deadband(loop) if loop else None for loop in bent],
        },
    }


def _width(strokes: RecordedStrokes, bend_deg: float) -> float | None:
    """Width of the loop at a bend, mean of both sides, as a fraction of 180 deg."""
    sides = [_fraction(*strokes.loop, sign * bend_deg) for sign in (1, -1)]
    found = [side for side in sides if side is not None]
    return sum(found) / 2 if len(found) == 2 else None


def _fraction(one: Branch, other: Branch, bend_deg: float) -> float | None:
    lost = width(one, other, radians(bend_deg))
    return None if lost is None else lost / pi


def _lost(branch: Branch) -> float | None:
    lost = lost_after_turn(branch)
    return None if lost is None else lost / pi


def _cell(share: float | None) -> str:
    return "-" if share is None else f"{share:.3f}"


def _deadband(strokes: RecordedStrokes) -> float:
    falling, rising = strokes.loop
    return (deadband(falling) + deadband(rising)) / 2


def _plain(request: Request) -> dict[str, Any]:
    options = {k: v for k, v in asdict(request).items() if k not in ("json", "map")}
    return {k: str(v) if isinstance(v, Path) else v for k, v in options.items()}
