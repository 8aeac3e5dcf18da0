"""`endolock run`: one scenario, one controller, one run folder."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from endolock.control import registry
from endolock.hw.api import ConfigError
from endolock.scripts.runs import folder_contents, output, record_table, rigs
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.series import run_all
from endolock.twin.world import instrument_files, scenario
from endolock.vision.track_eyes import Selection

SCENARIO = f"{', '.join(scenario.names())}, or a TOML file of the same form."
INSTRUMENT = f"Which endoscope: {', '.join(instrument_files.names())}, or a TOML file of that form."


@dataclass(frozen=True, kw_only=True)
class Request:
    """Run one controller on one scenario and write a run folder."""

    scenario: Annotated[tyro.conf.Positional[str], tyro.conf.arg(help=SCENARIO)]
    controller: Annotated[str, tyro.conf.arg(help=registry.help_text())] = "pi"
    rig: Annotated[str, tyro.conf.arg(help=rigs.rig_help())] = "twin"
    bench: tyro.conf.DisallowNone[Path | None] = None
    """With serial: TOML file of the bench; else bench.toml in the current folder, if it exists."""
    vision: Annotated[str, tyro.conf.arg(help=rigs.vision_help())] = "markers"
    select: tyro.conf.DisallowNone[str | None] = None
    """With track: region to follow in the first picture, as X,Y,WIDTH,HEIGHT [px]; else 41x41 px
    around the board's target."""
    instrument: Annotated[str, tyro.conf.arg(help=INSTRUMENT)] = "pretensioned"
    latency_s: tyro.conf.DisallowNone[float | None] = None
    """Exposure to delivery of a frame [s]; else the scenario's."""
    duration_s: tyro.conf.DisallowNone[float | None] = None
    """Duration of the run [s]; else the scenario's."""
    scored_from_s: tyro.conf.DisallowNone[float | None] = None
    """Time from which the run is scored [s]; else the scenario's."""
    vary: tuple[str, ...] = ()
    """Changes, all of them applied: KEY=VALUE with a key of the scenario file, instrument.NAME,
    law.NAME or numerics.NAME; or disturbances by name (models/disturbances), or TOML files of that
    form. A change without effect on this rig and vision is refused."""
    force: bool = False
    """Run a controller even if its gains make the loop unstable."""
    seed: int = 0
    """Seed of all random numbers; the same seed gives the same tables."""
    out: tyro.conf.DisallowNone[Path | None] = None
    """Run folder, new or empty; else one below runs/ named by time."""
    view: bool = False
    """Open the run in the Rerun viewer afterwards."""
    dry_run: bool = False
    """Print the resolved configuration with the source of each value, and stop."""
    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write the run record to this file as JSON; - prints only the JSON, on standard output."""


def main(request: Request) -> int:
    """Carry out `endolock run`; return the exit code."""
    from endolock.scripts.commands import dry_run, view
    from endolock.scripts.figures import rerun_export  # Rerun takes a second to load

    output.check_json(request.json)
    console = Console(stderr=request.json == "-")
    experiment = experiment_of(request)
    output.say(experiment.resolve().notes)
    if request.dry_run:
        return dry_run.show(experiment, request.json)
    series = run_all([experiment])
    (record,) = series.records
    folder = record.folder
    output.say(unseen(folder))
    with console.status("writing run.rrd"):
        rerun_export.derive(folder)
    output.write_json(record.as_dict(), request.json)
    if request.json != "-":
        console.print(record_table.table([record]))
        console.print(record_table.handles([record]))
        for line in record_table.legend([record]):
            console.print(line, soft_wrap=True, highlight=False)
        console.print(f"run folder: {folder}", soft_wrap=True, highlight=False, markup=False)
    if request.view:
        view.show(folder, console)
    series.conclude()
    return 0


def unseen(folder: Path) -> list[str]:
    """Say why the target was not found, where that was so in more than half of a run's pictures."""
    frames, reasons = 0, Counter[str]()
    for batch in folder_contents.batches(folder, "frames"):
        frames += batch.num_rows
        reasons.update(why for why in batch.column("why").to_pylist() if why)
    if 2 * reasons.total() <= frames:
        return []
    ((why, count),) = reasons.most_common(1)
    missed = f"the target was not found in {reasons.total()} of {frames} pictures"
    return [f"{missed}; {count} of them: {why}"]


def experiment_of(request: Request) -> Experiment:
    """Turn a request into an experiment.

    Raises:
        ConfigError: the selection cannot be read.
    """
    values = {field.name: getattr(request, field.name) for field in fields(Experiment)}
    return Experiment(**values | {"select": selection(request.select)})


def selection(text: str | None) -> Selection | None:
    """Read X,Y,WIDTH,HEIGHT.

    Raises:
        ConfigError: it is not four whole numbers.
    """
    if text is None:
        return None
    try:
        left, top, width, height = (int(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(
            f"--select '{text}' is not X,Y,WIDTH,HEIGHT in whole pixels",
            "use for example 300,220,41,41",
        ) from None
    return left, top, width, height
