"""`endolock run --dry-run`: the resolved configuration, and the source of each value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields
from typing import Any

from rich.console import Console
from rich.table import Table

from endolock.hw import files
from endolock.hw.bench.bench_file import Bench
from endolock.scripts.runs import effects, output, overrides
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.resolved import Resolved
from endolock.twin.physics import timestep_check
from endolock.twin.world import instrument_files, scenario
from endolock.twin.world.instrument import Instrument

Sourced = Iterator[tuple[str, tuple[Any, str]]]
"""Dotted keys, each with its value and the source of it."""


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
    """List every value of a run by dotted key, with its source.

    Sources are option, vary (a `--vary`), file (of the scenario), instrument and bench (their
    files; of a controller's value, what it follows from), scenario (the same), measured, default.
    """
    task = experiment.resolve()
    varied = {key for entry in experiment.vary for key, _ in overrides.changed_keys(entry)}
    found = dict(_scenario(experiment, task, varied))
    defaults = {field.name: field.default for field in fields(experiment)}
    for name in ("controller", "rig", "vision", "instrument", "seed"):
        value = getattr(experiment, name)
        found[f"run.{name}"] = (value, "default" if value == defaults[name] else "option")
    found |= _bench(task.bench) if task.bench else _simulated(experiment, task, varied)
    law = task.settings if isinstance(task.settings, dict) else asdict(task.settings)
    for key, value in law.items():
        source = "vary" if f"law.{key}" in varied else task.known.get(key, "default")
        found[f"law.{key}"] = (value, source)
    return found


def _scenario(experiment: Experiment, task: Resolved, varied: set[str]) -> Sourced:
    for key, (value, plain) in scenario.sources(experiment.scenario, task.changes).items():
        parts = key.split(".")
        above = {".".join(parts[: n + 1]) for n in range(len(parts))}  # lists are set as a whole
        source = plain
        if above & experiment.changes.keys():
            source = "option"
        elif task.bench and key == "camera.latency_s":
            source = "bench" if "latency_s" in task.bench.camera.model_fields_set else "default"
        elif above & varied:
            source = "vary"
        yield f"scenario.{key}", (value, source)


def _bench(bench: Bench) -> Sourced:
    """Yield what a bench is; its instrument is of hardware, not of values."""
    written = overrides.flat(bench.model_dump(mode="json", exclude_unset=True))
    for key, value in overrides.flat(bench.model_dump(mode="json")).items():
        yield f"bench.{key}", (value, "bench" if key in written else "default")


def _simulated(experiment: Experiment, task: Resolved, varied: set[str]) -> Sourced:
    chosen: Any = experiment.instrument
    given: Mapping[str, Any] = {}
    if isinstance(chosen, Instrument):
        given = {k: v for k, v in asdict(chosen).items() if v != getattr(Instrument(), k)}
    elif chosen != Experiment.instrument:  # the default is written out in its file
        given = files.read("instrument", instrument_files.FOLDER, str(chosen))[0]
    for key, value in asdict(task.instrument).items():
        source = "instrument" if key in given else "default"
        yield f"instrument.{key}", (value, "vary" if f"instrument.{key}" in varied else source)
    rig = experiment.rig
    if not isinstance(rig, str) or rig not in effects.PHYSICS:
        return  # nothing is simulated in steps
    for key, value in asdict(task.numerics).items():
        yield f"numerics.{key}", (value, "vary" if f"numerics.{key}" in varied else "default")
    used = task.instrument, task.numerics, task.scenario.shaft_bend_deg, task.scenario.gravity
    found = timestep_check.converging(*used)
    error_deg = timestep_check.timestep_error_deg(*used)
    yield "numerics.timestep_error_deg", (error_deg, "measured")
    yield "numerics.converging_timestep_s", (found.timestep_s if found else None, "measured")
