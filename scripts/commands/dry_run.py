"""`endolock run --dry-run`: the resolved configuration, and the source of each value."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

from rich.console import Console
from rich.table import Table

from endolock.scripts.runs import output, overrides
from endolock.scripts.runs.experiment import Experiment
from endolock.twin.world import scenario
from endolock.twin.world.instrument import Instrument, Numerics


def show(experiment: Experiment, json: str | None) -> int:
    """Print the resolved configuration; return the exit code.

    Args:
        experiment: made from names.
        json: file for the JSON; see `output.write_json`.

    Raises:
        ConfigError: the experiment cannot be run.
    """
    table = resolved(experiment)
    if json:
        rows = {key: {"value": value, "source": source} for key, (value, source) in table.items()}
        output.write_json(rows, json)
    if json != "-":
        layout = Table(title="dry run: resolved configuration", title_justify="left")
        for heading in ("key", "value", "source"):
            layout.add_column(heading)
        for key, (value, source) in table.items():
            layout.add_row(key, str(value), source)
        Console().print(layout)
    return 0


def resolved(experiment: Experiment) -> dict[str, tuple[Any, str]]:
    """List every value of a run by dotted key, with its source: option, file or default."""
    task = experiment.resolve()
    used = dict(scenario.sources(experiment.scenario, task.changes))
    found = {f"scenario.{key}": value for key, value in used.items()}
    defaults = {field.name: field.default for field in fields(experiment)}
    for name in ("controller", "rig", "vision", "instrument", "seed"):
        value = getattr(experiment, name)
        found[f"run.{name}"] = (value, "default" if value == defaults[name] else "option")
    default = asdict(Instrument())
    for key, value in asdict(task.instrument).items():
        found[f"instrument.{key}"] = (value, "default" if value == default[key] else "instrument")
    for key, value in asdict(Numerics()).items():
        found[f"numerics.{key}"] = (value, "default")
    law = task.settings if isinstance(task.settings, dict) else asdict(task.settings)
    changed = {key for entry in experiment.vary for key in overrides.read(entry).law}
    for key, value in law.items():
        found[f"law.{key}"] = (value, "option" if key in changed else "default")
    return found
