"""What a run would use, and where each value comes from."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

from endolock.scripts import output, run
from endolock.twin import scenario
from endolock.twin.instrument import Instrument, Numerics

if TYPE_CHECKING:
    from collections.abc import Mapping


def show(request: run.Request) -> int:
    """Print the resolved configuration; return the exit code.

    Raises:
        ConfigError: the request cannot be carried out.
    """
    table = resolved(request)
    if request.json:
        rows = {key: {"value": value, "source": source} for key, (value, source) in table.items()}
        output.write_json(rows, request.json)
    if request.json != "-":
        layout = Table(title="nothing was run", title_justify="left")
        for heading in ("key", "value", "source"):
            layout.add_column(heading)
        for key, (value, source) in table.items():
            layout.add_row(key, str(value), source)
        Console().print(layout)
    return 0


def resolved(request: run.Request) -> dict[str, tuple[Any, str]]:
    """List every value of a run by dotted key, with its source: option, file or default."""
    run.resolve(request)
    used = dict(scenario.sources(request.scenario, run.overrides(request)))
    found = {f"scenario.{key}": value for key, value in used.items()}
    defaults = {field.name: field.default for field in dataclasses.fields(run.Request)}
    options: Mapping[str, Any] = dataclasses.asdict(request)
    for name in ("controller", "rig", "vision", "instrument", "seed"):
        value = options[name]
        found[f"run.{name}"] = (value, "default" if value == defaults[name] else "option")
    for part in (Instrument(), Numerics()):
        name = type(part).__name__.lower()
        found |= {f"{name}.{key}": (v, "default") for key, v in dataclasses.asdict(part).items()}
    return found
