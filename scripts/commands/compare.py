"""`endolock compare`: laws on scenarios, latencies, variations and seeds; a table and a figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pyarrow.compute as pc
import tyro
from rich.console import Console

from endolock.control import registry
from endolock.hw.api import ConfigError
from endolock.scripts.commands import run
from endolock.scripts.figures.palette import SERIES
from endolock.scripts.runs import output, overrides, record_table, rigs, run_folder, theory
from endolock.vision.observation import Status


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
    rig: str = "twin"
    """What to drive: twin, hil, hil:wall, serial:PORT, surrogate, play or quasi_static, as for
    run."""
    bench: tyro.conf.DisallowNone[Path | None] = None
    """With serial: TOML file of the bench; else bench.toml in this folder, if there is one."""
    vision: str = "markers"
    """markers: find the board in the pictures; track: follow the target without markers; truth: no
    pictures, exact projections, faster."""
    instrument: str = "pretensioned"
    """Which endoscope: pretensioned, slack, two_region, thesis, or a TOML file of that form."""
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
    place = request.out or run_folder.new_path(Path("runs"), "compare")
    console = Console(stderr=request.json == "-")
    if request.thesis:
        return _thesis(request, place, console)
    records, folders = perform(request, place)
    with console.status("working out margins and floors"):
        planned = plan(request, None)
        told = [theory.of(one) for one in planned[: len(records)]]
        records = [{**record, **more} for record, more in zip(records, told, strict=True)]
    with console.status("drawing errors.png"):
        figure = draw(records, folders, place / "errors.png")
    output.write_json({"rows": records}, request.json)
    if request.json != "-":
        console.print(record_table.table(records))
        for line in (
            *record_table.legend(records),
            *_needs(records),
            *_margins(records),
            *_floors(records),
        ):
            console.print(line, soft_wrap=True, highlight=False)
        console.print(f"error over time: {figure}", soft_wrap=True, highlight=False, markup=False)
        if (last := records[-1])["interrupted"]:
            console.print(
                f"interrupted: {len(records)} of {len(planned)} runs, the last one after "
                f"{last['duration_s']:.1f} s",
                highlight=False,
            )
    return 130 if records[-1]["interrupted"] else 0


def _thesis(request: Request, place: Path, console: Console) -> int:
    from endolock.scripts.thesis import chapter_figures, chapter_runs, statements

    require_empty(place)
    rigs.check("twin", request.vision)
    records, runs = chapter_runs.perform(place, request.vision)
    if records[-1]["interrupted"]:
        output.write_json({"rows": records}, request.json)
        console.print(f"interrupted: {len(records)} runs in {place}, nothing was checked")
        return 130
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


def _needs(records: Sequence[dict[str, Any]]) -> list[str]:
    told: dict[tuple[str, int], Any] = {}  # the first of each, which is nominal
    for r in records:
        if r["needed_tip_deg"]:
            told.setdefault((r["scenario"], r["seed"]), r["needed_tip_deg"])
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


def perform(request: Request, place: Path) -> tuple[list[dict[str, Any]], list[Path]]:
    """Carry out all runs, up to a Ctrl-C.

    Args:
        request: what to run.
        place: holds a run folder for each.

    Returns:
        The run records, and the run folder of each.

    Raises:
        ConfigError: something cannot be carried out; nothing was written.
    """
    planned = plan(request, place)
    records: list[dict[str, Any]] = []
    for n, one in enumerate(planned, 1):
        record, _ = run.perform(one, label=f"{n}/{len(planned)}")
        records.append(record)
        if record["interrupted"]:
            break
    return records, [one.out for one in planned[: len(records)] if one.out]


def plan(request: Request, place: Path | None) -> list[run.Request]:
    """List the runs, each with its folder below `place`, if any; all are checked before the first.

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
    if place:
        require_empty(place)
    variations = [one for entry in request.vary for one in overrides.expand(entry)]
    cases = product(
        request.scenarios,
        request.controllers,
        request.latencies or (None,),
        ["", *variations],
        range(request.seeds),
    )
    planned: list[run.Request] = []
    for source, law, latency_s, varied, seed in cases:
        entries = tuple(varied.split("+")) if varied else ()
        parts = [Path(source).stem, Path(law).stem]
        parts += [overrides.label(entries).replace("/", "_")] if varied else []
        parts += [] if latency_s is None else [f"{latency_s:g}s"]
        parts += [f"seed{seed}"] if request.seeds > 1 else []
        one = run.Request(
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
            out=(place or Path()) / "-".join(parts),
        )
        run.resolve(one)
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


def draw(records: Sequence[dict[str, Any]], folders: Sequence[Path], path: Path) -> Path:
    """Draw the true error of every run over time, one panel a scenario, one colour a law.

    Args:
        records: run records.
        folders: the run folder of each.
        path: the PNG to write.
    """
    from matplotlib.figure import Figure  # half a second to load

    names = list(dict.fromkeys(record["scenario"] for record in records))
    laws_used = list(dict.fromkeys(record["controller"] for record in records))
    figure = Figure(figsize=(9, 0.6 + 2.6 * len(names)), layout="constrained")
    panels = figure.subplots(len(names), 1, squeeze=False)[:, 0]
    for record, folder in zip(records, folders, strict=True):
        panel = panels[names.index(record["scenario"])]
        t, error = error_over_time(folder)
        law = record["controller"]
        colour = SERIES[laws_used.index(law) % len(SERIES)]
        first = law not in panel.get_legend_handles_labels()[1]
        panel.plot(t, error, color=colour, lw=1.2, label=law if first else None)
    for panel, name in zip(panels, names, strict=True):
        panel.set_title(name, loc="left", fontsize=10)
        panel.set_ylabel("error [px]")
        panel.set_ylim(bottom=0)
        panel.margins(x=0)
        panel.grid(alpha=0.3)
        place = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.0}
        panel.legend(ncols=len(laws_used), frameon=False, **place)
    panels[-1].set_xlabel("time [s]")
    figure.savefig(path, dpi=130)
    return path


def error_over_time(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and errors [px] of a logged run: the true ones; on a bench what vision saw."""
    rows = run_folder.read(folder, "ticks")
    centre = run_folder.configuration(folder)["calibration"]["centre_px"]
    t = rows["t"]
    if rows["target_px"].null_count == rows.num_rows:
        rows = run_folder.read(folder, "frames")
        rows = rows.filter(pc.equal(rows["status"], Status.TRACKING))
        t = rows["t_available"]
    pixels = np.array(rows["target_px"].to_pylist(), float).reshape(-1, 2)
    return np.array(t), np.hypot(*(pixels - centre).T)
