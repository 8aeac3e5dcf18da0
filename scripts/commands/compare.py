"""`endolock compare`: laws on scenarios, latencies, variations and seeds; a table and a figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from endolock.control import registry
from endolock.hw.api import ConfigError
from endolock.scripts.commands.run import INSTRUMENT
from endolock.scripts.figures import error_figure
from endolock.scripts.runs import output, overrides, record_table, rigs, run_folder, theory
from endolock.scripts.runs.experiment import RUNS, Experiment
from endolock.scripts.runs.run_record import RunRecord
from endolock.scripts.runs.series import run_all


@dataclass(frozen=True, kw_only=True)
class Request:
    """Run laws against each other on the same scenarios."""

    scenarios: tuple[str, ...] = ("straight", "circle")
    """Scenarios by name, or TOML files."""
    controllers: tuple[str, ...] = ("still", "pi", "ik")
    """Control laws, as for run."""
    seeds: int = 1
    """Repeat each run with this many seeds: 0, 1, ..."""
    latencies: tuple[float, ...] = ()
    """Exposure to delivery of a frame [s], one run each; else the scenario's."""
    vary: tuple[str, ...] = ()
    """Besides nominal, run each of these: KEY=VALUE or KEY=A,B with keys as for run, disturbances
    by name, or TOML files of that form; several at once are joined by +."""
    thesis: bool = False
    """Draw figures 6.4 to 6.8 of the thesis again, and check what its excerpt states; of the
    options, only vision, json and out count."""
    rig: Annotated[str, tyro.conf.arg(help=rigs.rig_help())] = "twin"
    bench: tyro.conf.DisallowNone[Path | None] = None
    """With serial: TOML file of the bench; else bench.toml in this folder, if there is one."""
    vision: Annotated[str, tyro.conf.arg(help=rigs.vision_help())] = "markers"
    instrument: Annotated[str, tyro.conf.arg(help=INSTRUMENT)] = "pretensioned"
    duration_s: tyro.conf.DisallowNone[float | None] = None
    """How long each run is [s]; else the scenario's."""
    scored_from_s: tyro.conf.DisallowNone[float | None] = None
    """Leave what comes before out of the score [s]; else the scenario's."""
    out: tyro.conf.DisallowNone[Path | None] = None
    """Folder for the run folders and the figure, new or empty; else one below runs/."""
    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write {"rows": [run records]}, with --thesis also "thesis": [statements], there as JSON; -
    prints it, and nothing else, on standard output."""


def main(request: Request) -> int:
    """Carry out `endolock compare`; return the exit code."""
    output.check_json(request.json)
    place = request.out or run_folder.new_path(RUNS, "compare")
    console = Console(stderr=request.json == "-")
    if request.thesis:
        return _thesis(request, place, console)
    planned = plan(request, place)
    series = run_all(planned)
    records = series.records
    with console.status("working out margins and floors"):
        rows = [
            record.as_dict() | theory.of(task.scenario, task.settings)
            for record, task in zip(records, map(Experiment.resolve, planned), strict=False)
        ]
    with console.status("drawing errors.png"):
        figure = error_figure.draw(records, place / "errors.png")
    output.write_json({"rows": rows}, request.json)
    if request.json != "-":
        console.print(record_table.table(records))
        for line in (
            *record_table.legend(records),
            *_needs(records),
            *_margins(rows),
            *_floors(rows),
        ):
            console.print(line, soft_wrap=True, highlight=False)
        console.print(f"error over time: {figure}", soft_wrap=True, highlight=False, markup=False)
    series.conclude()
    return 0


def _thesis(request: Request, place: Path, console: Console) -> int:
    from endolock.scripts.thesis import chapter_figures, chapter_runs, statements

    require_empty(place)
    rigs.check("twin", request.vision)
    series, runs = chapter_runs.perform(place, request.vision)
    records = [record.as_dict() for record in series.records]
    if series.stopped:
        output.write_json({"rows": records}, request.json)
        console.print(f"{len(records)} runs in {place}, nothing was checked")
        series.conclude()
    rows = statements.ask(runs)
    with console.status("drawing figures 6.4 to 6.8"):
        figures = chapter_figures.draw(runs, place)
    output.write_json({"rows": records, "thesis": rows}, request.json)
    if request.json != "-":
        for part in chapter_runs.layout(rows):
            console.print(part, highlight=False)
        for figure in figures:
            console.print(str(figure), soft_wrap=True, highlight=False, markup=False)
    return 0


def _margins(records: Sequence[dict[str, Any]]) -> list[str]:
    told: dict[tuple[Any, ...], Any] = {}  # the first of each, which is nominal
    for r in records:
        told.setdefault((r["controller"], r["scenario"], r["latency_s"]), r["margins"])
    alike: dict[str, list[str]] = {}
    for (law, scenario, latency), m in told.items():
        if m:
            text = f"{law}, {latency:.2f} s, linear part: gain margin {m['gain']:.1f}, " + (
                f"phase margin {m['phase_deg']:.0f} deg, dead time margin {m['dead_s']:.2f} s"
                if m["gain"] >= 1
                else "unstable"
            )
            alike.setdefault(text, []).append(scenario)
    return [f"{text} on {', '.join(scenarios)}" for text, scenarios in alike.items()]


def _needs(records: Sequence[RunRecord]) -> list[str]:
    told: dict[tuple[str, int], Any] = {}  # the first of each, which is nominal
    for r in records:
        if r.needed_tip_deg:
            told.setdefault((r.scenario, r.seed), r.needed_tip_deg)
    several = len({seed for _, seed in told}) > 1
    return [
        f"{scenario}{f', seed {seed}' if several else ''}: the path needs {up_down:.0f} deg of tip "
        f"up_down, {left_right:.0f} left_right"
        for (scenario, seed), (up_down, left_right) in told.items()
    ]


def _floors(records: Sequence[dict[str, Any]]) -> list[str]:
    told: dict[tuple[Any, ...], Any] = {}
    for r in records:
        told.setdefault((r["scenario"], r["latency_s"]), r["floor_px"])
    return [
        f"{scenario}, {latency:.2f} s: no prediction comes below {floor:.1f} px rms (Wiener)"
        for (scenario, latency), floor in told.items()
        if floor is not None
    ]


def plan(request: Request, place: Path) -> list[Experiment]:
    """List the runs, each with its folder below `place`; all are checked before the first.

    Raises:
        ConfigError: a scenario, law or number cannot be used, or the folder is not empty.
    """
    if request.seeds < 1:
        raise ConfigError(f"seeds {request.seeds}", "use 1 or more")
    for what in ("scenarios", "controllers"):
        if not getattr(request, what):
            raise ConfigError(f"no {what} given", f"name at least one after --{what}")
    for name in request.controllers:
        registry.check(name)
    require_empty(place)
    variations = [one for entry in request.vary for one in overrides.expand(entry)]
    cases = product(
        request.scenarios,
        request.controllers,
        request.latencies or (None,),
        ["", *variations],
        range(request.seeds),
    )
    planned: list[Experiment] = []
    for source, law, latency_s, varied, seed in cases:
        entries = tuple(varied.split("+")) if varied else ()
        parts = [Path(source).stem, Path(law).stem]
        parts += [overrides.label(entries).replace("/", "_")] if varied else []
        parts += [] if latency_s is None else [f"{latency_s:g}s"]
        parts += [f"seed{seed}"] if request.seeds > 1 else []
        one = Experiment(
            scenario=source,
            controller=law,
            rig=request.rig,
            bench=request.bench,
            vision=request.vision,
            instrument=request.instrument,
            vary=entries,
            latency_s=latency_s,
            duration_s=request.duration_s,
            scored_from_s=request.scored_from_s,
            seed=seed,
            out=place / "-".join(parts),
        )
        one.resolve()
        planned.append(one)
    if len({one.out for one in planned}) < len(planned):
        raise ConfigError("two runs are the same", "name every scenario, law and latency once")
    return planned


def require_empty(place: Path) -> None:
    """See that results can go there.

    Raises:
        ConfigError: there is something already.
    """
    if place.exists() and (not place.is_dir() or any(place.iterdir())):
        raise ConfigError(f"{place} is not an empty folder", "give a new one with --out")
