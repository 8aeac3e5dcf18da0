"""`endolock benchmark`: speed of the parts, as ratios to a bound measured in the same minute.

Machines are shared and noisy: each time is the median of interleaved repetitions, and what counts
is the ratio to bare `mj_step`, to a raw OpenGL quad, or to simulated time.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.table import Table

from endolock.scripts.commands import identify
from endolock.scripts.runs import output
from endolock.scripts.runs.hysteresis_measurement import HysteresisMeasurement
from endolock.scripts.speed import (
    environment_speed,
    link_speed,
    picture_speed,
    plant_speed,
    run_speed,
    tick_times,
)


@dataclass(frozen=True, kw_only=True)
class Request:
    """Measure the speed of physics, rendering, vision, control, link, logging, protocols and runs.

    With Gymnasium installed (./run test --extra), the environments are measured too.
    """

    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write the figures to this file as JSON; - prints only the JSON on standard output."""


def main(request: Request) -> int:
    """Carry out `endolock benchmark`; return the exit code."""
    output.check_json(request.json)
    figures: dict[str, Any] = {}
    with Console(stderr=True).status("measuring") as status:
        for name, measure in MEASURES.items():
            if name == "env" and not environment_speed.available():
                continue
            status.update(f"measuring {name}")
            figures[name] = measure()
    output.write_json(figures, request.json)
    if request.json != "-":
        Console().print(_table(figures))
    return 0


def protocols() -> dict[str, float]:
    """Wall time of `endolock hysteresis` and of `endolock identify` on its log [s]."""
    with tempfile.TemporaryDirectory() as name:
        log_folder = Path(name) / "log"
        measured = HysteresisMeasurement(out=log_folder).run()
        fitted = identify.perform(identify.Request(log=log_folder))
    return {"hysteresis_s": measured["wall_s"], "identify_s": fitted["wall_s"]}


MEASURES: Mapping[str, Callable[[], dict[str, Any]]] = {
    "physics": plant_speed.physics,
    "render": picture_speed.render,
    "vision": picture_speed.vision,
    "pipeline": run_speed.pipeline,
    "surrogate": plant_speed.surrogate,
    "control": tick_times.mean,
    "control_p99": tick_times.p99,
    "link": link_speed.measure,
    "log": run_speed.log,
    "protocols": protocols,
    "env": environment_speed.environments,
}
"""Measurements by their key in the JSON, in the order they are taken."""


def _table(figures: dict[str, Any]) -> Table:
    result = Table(title="endolock benchmark (rtf: simulated seconds per second)")
    for heading in ("part", "figure", "value"):
        result.add_column(heading, justify="right" if heading == "value" else "left")
    for part, values in figures.items():
        for name, value in values.items():
            shown = value if isinstance(value, str) else f"{value:.3g}"
            result.add_row(part, name, shown)
        result.add_section()
    return result
