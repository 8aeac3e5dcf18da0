"""`endolock benchmark`: speed of the parts, as ratios to a bound measured in the same minute."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.table import Table

from endolock.scripts.runs import output
from endolock.scripts.speed import speed_of_parts


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
    with Console(stderr=True).status("measuring") as status:
        figures = speed_of_parts.measure(lambda part: status.update(f"measuring {part}"))
    output.write_json(figures, request.json)
    if request.json != "-":
        Console().print(_table(figures))
    return 0


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
