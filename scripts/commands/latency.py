"""`endolock latency`: latency of the video, from handle motion and image motion."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from endolock.scripts.commands.run import INSTRUMENT
from endolock.scripts.runs import output, rigs
from endolock.scripts.runs.latency_measurement import LatencyMeasurement


@dataclass(frozen=True, kw_only=True)
class Request:
    """Measure the latency of the video, from exposure to delivery, without the time for vision."""

    rig: Annotated[str, tyro.conf.arg(help=rigs.pictured_rig_help())] = "twin"
    bench: tyro.conf.DisallowNone[Path | None] = None
    """With serial: TOML file of the bench; default: bench.toml in the current folder, if there is
    one."""
    scenario: str = "rest"
    """Scenario in front of the camera; it must be at rest."""
    axis: str = "left_right"
    """Handle that turns: up_down or left_right."""
    instrument: Annotated[str, tyro.conf.arg(help=INSTRUMENT)] = "pretensioned"
    latency_s: tyro.conf.DisallowNone[float | None] = None
    """Latency of the twin's video, unknown to the measurement [s]; default: the scenario's."""
    jitter_s: tyro.conf.DisallowNone[float | None] = None
    """Jitter of the twin's latency, +- [s]; default: the scenario's."""
    strokes: int = 8
    """Number of strokes, 4 or more."""
    seed: int = 0
    """Seed of all random numbers."""
    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write the result to this file as JSON; - prints only the JSON on standard output."""


def main(request: Request) -> int:
    """Carry out `endolock latency`; return the exit code."""
    output.check_json(request.json)
    values = {field.name: getattr(request, field.name) for field in fields(LatencyMeasurement)}
    record = LatencyMeasurement(**values).run(show_progress=True)
    output.write_json(asdict(record), request.json)
    if request.json != "-":
        low, high = record.ci95_s
        console = Console(highlight=False)
        console.print(
            f"latency     {record.latency_s:.3f} s  (95 % between {low:.3f} and {high:.3f} s)"
        )
        console.print(f"jitter      {1e3 * record.jitter_s:.1f} ms (standard deviation)")
        console.print(f"frame rate  {record.frame_rate_hz:.2f} Hz")
        console.print(
            f"vision      {record.vision_ms:.1f} ms per frame for the markers, not part of the "
            "latency"
        )
    return 0
