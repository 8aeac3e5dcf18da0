"""What a run would use, and where each value comes from."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

from endolock.scripts.commands import run
from endolock.scripts.runs import output, overrides
from endolock.twin.world import scenario
from endolock.twin.world.instrument import Instrument, Numerics

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
    task = run.resolve(request)
    used = dict(scenario.sources(request.scenario, task.changes))
    found = {f"scenario.{key}": value for key, value in used.items()}
    defaults = {field.name: field.default for field in dataclasses.fields(run.Request)}
    options: Mapping[str, Any] = dataclasses.asdict(request)
    for name in ("controller", "rig", "vision", "instrument", "seed"):
        value = options[name]
        found[f"run.{name}"] = (value, "default" if value == defaults[name] else "option")
    usual = dataclasses.asdict(Instrument())
    for key, value in dataclasses.asdict(task.instrument).items():
        found[f"instrument.{key}"] = (value, "default" if value == usual[key] else "instrument")
    for key, value in dataclasses.asdict(Numerics()).items():
        found[f"numerics.{key}"] = (value, "default")
    law = dataclasses.asdict(task.settings) if task.settings else {}
    changed = {key for entry in request.vary for key in overrides.read(entry).law}
    for key, value in law.items():
        found[f"law.{key}"] = (value, "option" if key in changed else "default")
    return found
