"""`endolock compare`: a table and a figure of controllers, scenarios, latencies and variations."""

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
    """Run several controllers on the same scenarios and compare their errors."""

    scenarios: tuple[str, ...] = ("straight", "circle")
    """Scenarios by name, or TOML files."""
    controllers: tuple[str, ...] = ("still", "pi", "ik")
    """Controllers, as for run."""
    seeds: int = 1
    """Repeat each run with this many seeds: 0, 1, ..."""
    latencies: tuple[float, ...] = ()
    """Run with each of these video latencies, exposure to delivery of a frame [s]; else the
    scenario's."""
    vary: tuple[str, ...] = ()
    """Besides the nominal runs, run each of these variations: KEY=VALUE or KEY=A,B with keys as for
    run, disturbances by name, or TOML files of that form; + joins several into one variation."""
    thesis: bool = False
    """Reproduce figures 6.4 to 6.8 of the thesis and check the statements of its excerpt; uses only
    the options vision, json and out."""
    rig: Annotated[str, tyro.conf.arg(help=rigs.rig_help())] = "twin"
    bench: tyro.conf.DisallowNone[Path | None] = None
    """With serial: TOML file of the bench; else bench.toml in the current folder, if it exists."""
    vision: Annotated[str, tyro.conf.arg(help=rigs.vision_help())] = "markers"
    instrument: Annotated[str, tyro.conf.arg(help=INSTRUMENT)] = "pretensioned"
    duration_s: tyro.conf.DisallowNone[float | None] = None
    """Duration of each run [s]; else the scenario's."""
    scored_from_s: tyro.conf.DisallowNone[float | None] = None
    """Time from which the runs are scored [s]; else the scenario's."""
    out: tyro.conf.DisallowNone[Path | None] = None
    """Folder for the run folders and the figure, new or empty; else one below runs/."""
    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write {"rows": [run records]}, with --thesis also "thesis": [statements], to this file as
    JSON; - prints only the JSON, on standard output."""


def main(request: Request) -> int:
    """Carry out `endolock compare`; return the exit code."""
    output.check_json(request.json)
    console = Console(stderr=request.json == "-")
    with run_folder.series_folder(request.out, RUNS, "compare") as folder:
        return (_thesis if request.thesis else _compare)(request, folder, console)


def _compare(request: Request, folder: Path, console: Console) -> int:
    planned = plan(request, folder)
    output.say(note for task in planned for note in task.resolve().notes)
    series = run_all(planned)
    records = series.records
    with console.status("computing margins and floors"):
        rows = [
            record.as_dict() | theory.of(task.scenario, task.settings)
            for record, task in zip(records, map(Experiment.resolve, planned), strict=False)
        ]
    with console.status("drawing errors.png"):
        figure = error_figure.draw(records, folder / "errors.png")
    output.write_json({"rows": rows}, request.json)
    if request.json != "-":
        console.print(record_table.table(records))
        console.print(record_table.handles(records))
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


def _thesis(request: Request, folder: Path, console: Console) -> int:
    from endolock.scripts.thesis import chapter_figures, chapter_runs, statements

    require_empty(folder)
    rigs.check("twin", request.vision)
    series, runs = chapter_runs.perform(folder, request.vision)
    records = [record.as_dict() for record in series.records]
    if series.stopped:
        output.write_json({"rows": records}, request.json)
        console.print(f"{len(records)} runs in {folder}; no statement was checked")
        series.conclude()
    rows = statements.ask(runs)
    with console.status("drawing figures 6.4 to 6.8"):
        figures = chapter_figures.draw(runs, folder)
    output.write_json({"rows": records, "thesis": rows}, request.json)
    if request.json != "-":
        for part in chapter_runs.layout(rows):
            console.print(part, highlight=False)
        for figure in figures:
            console.print(str(figure), soft_wrap=True, highlight=False, markup=False)
    return 0


def _margins(records: Sequence[dict[str, Any]]) -> list[str]:
    nominal: dict[tuple[Any, ...], Any] = {}  # the nominal run comes first
    for r in records:
        nominal.setdefault((r["controller"], r["scenario"], r["latency_s"]), r["margins"])
    scenarios_of: dict[str, list[str]] = {}
    for (controller, scenario, latency), m in nominal.items():
        if m:
            text = f"{controller}, {latency:.2f} s, linear part: gain margin {m['gain']:.1f}, " + (
                f"phase margin {m['phase_deg']:.0f} deg, dead time margin {m['dead_s']:.2f} s"
                if m["gain"] >= 1
                else "unstable"
            )
            scenarios_of.setdefault(text, []).append(scenario)
    return [f"{text} on {', '.join(scenarios)}" for text, scenarios in scenarios_of.items()]


def _needs(records: Sequence[RunRecord]) -> list[str]:
    nominal: dict[tuple[str, int], Any] = {}  # the nominal run comes first
    for r in records:
        if r.needed_tip_deg:
            nominal.setdefault((r.scenario, r.seed), r.needed_tip_deg)
    several = len({seed for _, seed in nominal}) > 1
    return [
        f"{scenario}{f', seed {seed}' if several else ''}: the path needs {up_down:.0f} deg of tip "
        f"up_down, {left_right:.0f} left_right"
        for (scenario, seed), (up_down, left_right) in nominal.items()
    ]


def _floors(records: Sequence[dict[str, Any]]) -> list[str]:
    floors: dict[tuple[Any, ...], Any] = {}
    for r in records:
        floors.setdefault((r["scenario"], r["latency_s"]), r["floor_px"])
    return [
        f"{scenario}, {latency:.2f} s: lowest error of any prediction {floor:.1f} px rms (Wiener)"
        for (scenario, latency), floor in floors.items()
        if floor is not None
    ]


def plan(request: Request, folder: Path) -> list[Experiment]:
    """List the runs, each with its folder below `folder`; all are checked before the first starts.

    Raises:
        ConfigError: a scenario, controller or number cannot be used, or the folder is not empty.
    """
    if request.seeds < 1:
        raise ConfigError(f"seeds {request.seeds}", "use 1 or more")
    for option in ("scenarios", "controllers"):
        if not getattr(request, option):
            raise ConfigError(f"no {option} given", f"name at least one after --{option}")
    for name in request.controllers:
        registry.check(name)
    require_empty(folder)
    variations = [case for entry in request.vary for case in overrides.expand(entry)]
    cases = product(
        request.scenarios,
        request.controllers,
        request.latencies or (None,),
        ["", *variations],
        range(request.seeds),
    )
    planned: list[Experiment] = []
    for source, controller, latency_s, varied, seed in cases:
        entries = tuple(varied.split("+")) if varied else ()
        parts = [Path(source).stem, Path(controller).stem]
        parts += [overrides.label(entries).replace("/", "_")] if varied else []
        parts += [] if latency_s is None else [f"{latency_s:g}s"]
        parts += [f"seed{seed}"] if request.seeds > 1 else []
        experiment = Experiment(
            scenario=source,
            controller=controller,
            rig=request.rig,
            bench=request.bench,
            vision=request.vision,
            instrument=request.instrument,
            vary=entries,
            latency_s=latency_s,
            duration_s=request.duration_s,
            scored_from_s=request.scored_from_s,
            seed=seed,
            out=folder / "-".join(parts),
        )
        experiment.resolve()
        planned.append(experiment)
    for n, experiment in enumerate(planned):
        if any(experiment.out == other.out for other in planned[:n]):
            raise ConfigError(
                f"two runs have the folder {experiment.out}",
                "give every scenario, controller and latency once, and files other names",
            )
    return planned


def require_empty(folder: Path) -> None:
    """Check that a folder for results is new or empty.

    Raises:
        ConfigError: it is not.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(f"{folder} is not an empty folder", "give a new one with --out")
