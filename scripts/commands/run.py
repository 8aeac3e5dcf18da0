"""`endolock run`: one scenario, one law, one run folder."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import tyro
from rich.console import Console

from endolock.control import loop, metrics, registry
from endolock.control.transmission.kinematics import SectionGeometry
from endolock.control.transmission.linear_process import HOLD_S, Process, image_gain
from endolock.hw.api import ConfigError
from endolock.hw.bench.bench_file import Bench
from endolock.scripts.runs import output, overrides, record_table, rigs, run_folder
from endolock.scripts.runs.progress import closing, progress
from endolock.scripts.runs.target_path import hindsight
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.scenario import Scenario
from endolock.vision.track_eyes import Selection

UNRECORDED = ("json", "view", "dry_run")
"""Options that change nothing about the run."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Run one control law on one scenario and write a run folder."""

    scenario: tyro.conf.Positional[str]
    """straight, circle, triangle, random, close, jump, roll, push, breathing, shaft_loop,
    occlusion, endoscope, rest, or a TOML file of the same form."""
    controller: str = "pi"
    """Control law: still (holds), pi, pi_hc, pi_simc, pi_simc_hc, ik, ik_sync, smith, repetitive,
    predictive, predictive_bank, oracle (knows the truth: a floor), or a .py file that defines
    make(calibration)."""
    rig: str = "twin"
    """What to drive: twin; hil (the twin at the end of a serial line, in lock-step; hil:wall by the
    wall clock); serial:PORT (a bench); or a model without physics and pictures: surrogate (plays
    fitted to the instrument), play (one of constant width), quasi_static (its wires, without
    inertia)."""
    bench: tyro.conf.DisallowNone[Path | None] = None
    """With serial: TOML file of the bench; else bench.toml in this folder, if there is one."""
    vision: str = "markers"
    """markers: find the board in the pictures; track: follow the target without markers; truth: no
    pictures, exact projections, faster."""
    select: tyro.conf.DisallowNone[str | None] = None
    """With track: rectangle of the first picture to follow, as X,Y,WIDTH,HEIGHT [px]; else 41x41 px
    around the board's target."""
    instrument: str = "pretensioned"
    """Which endoscope: pretensioned, slack, two_region, thesis, or a TOML file of that form."""
    latency_s: tyro.conf.DisallowNone[float | None] = None
    """Exposure to delivery of a frame [s]; else the scenario's."""
    duration_s: tyro.conf.DisallowNone[float | None] = None
    """How long to run [s]; else the scenario's."""
    scored_from_s: tyro.conf.DisallowNone[float | None] = None
    """Leave what comes before out of the score [s]; else the scenario's."""
    vary: tuple[str, ...] = ()
    """Changes, all of them applied: KEY=VALUE with a key of the scenario file, instrument.NAME or
    law.NAME; or disturbances by name (models/disturbances), or TOML files of that form."""
    force: bool = False
    """Run a law also where its gains make the loop unstable."""
    seed: int = 0
    """Of every random number; the same seed gives the same tables."""
    out: tyro.conf.DisallowNone[Path | None] = None
    """Run folder, new or empty; else one below runs/ named by time."""
    view: bool = False
    """Open the run in the Rerun viewer afterwards."""
    dry_run: bool = False
    """Print the resolved configuration with the source of each value, and stop."""
    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write the run record there as JSON; - prints it, and nothing else, on standard output."""


def main(request: Request) -> int:
    """Carry out `endolock run`; return the exit code."""
    from endolock.scripts.commands import view
    from endolock.scripts.figures import rerun_export  # Rerun takes a second to load
    from endolock.scripts.runs import dry_run

    output.check_json(request.json)
    console = Console(stderr=request.json == "-")
    if request.dry_run:
        return dry_run.show(request)
    record, folder = perform(request)
    with console.status("writing run.rrd"):
        rerun_export.derive(folder)
    output.write_json(record, request.json)
    if request.json != "-":
        console.print(record_table.table([record]))
        for line in record_table.legend([record]):
            console.print(line, soft_wrap=True, highlight=False)
        console.print(f"run folder: {folder}", soft_wrap=True, highlight=False, markup=False)
    if request.view:
        view.show(folder, console)
    return 130 if record["interrupted"] else 0


def options_of(request: Request) -> dict[str, float]:
    """List what a request changes in its scenario, by dotted key."""
    options = {
        "camera.latency_s": request.latency_s,
        "duration_s": request.duration_s,
        "scored_from_s": request.scored_from_s,
    }
    return {key: value for key, value in options.items() if value is not None}


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
            "use such as 300,220,41,41",
        ) from None
    return left, top, width, height


class Resolved(NamedTuple):
    """What a request comes to."""

    scenario: Scenario
    instrument: Instrument
    settings: Any
    """Of the law; None of a law from a file."""
    changes: dict[str, Any]
    """What differs from the scenario's file, by dotted key."""
    bench: Bench | None
    """What a serial rig is made of."""


def resolve(request: Request) -> Resolved:
    """Check a request and load what it names; nothing is made or written.

    Raises:
        ConfigError: the request cannot be carried out.
    """
    registry.check(request.controller)
    rigs.check(request.rig, request.vision)
    selection(request.select)
    bench = rigs.bench_of(request.rig, request.bench)
    own = request.instrument != "pretensioned"
    if bench and (own or any(entry.startswith("instrument.") for entry in request.vary)):
        raise ConfigError(
            "a bench is what it is",
            f"--instrument and instrument.NAME do not go with {request.rig}",
        )
    changed = options_of(request)
    if bench:  # what the bench's camera is like is no choice of the scenario
        changed.setdefault("camera.latency_s", bench.camera.latency_s)
    task = overrides.apply(request.scenario, request.instrument, request.vary, changed)
    scenario = task.scenario
    if scenario.scored_from_s >= scenario.duration_s:
        raise ConfigError(
            f"scored_from_s {scenario.scored_from_s:g} is not before the end at "
            f"{scenario.duration_s:g} s",
            "use a smaller one or a longer duration_s",
        )
    known: dict[str, Any] = {}
    if scenario.period_s is not None:
        known["period_s"] = scenario.period_s
    if request.controller == "oracle":
        shaft_deg = scenario.shaft_bend_deg
        known["plays"] = rigs.plays_behind(request.rig, task.instrument, shaft_deg)
    settings = registry.configure(request.controller, task.law, known)
    if task.law and not request.force:
        _check_stable(request.controller, settings, scenario)
    return Resolved(scenario, task.instrument, settings, task.changes, bench)


def _check_stable(name: str, settings: Any, scenario: Scenario) -> None:
    """See that changed gains leave a margin.

    Raises:
        ConfigError: they leave none.
    """
    from endolock.control import analysis  # python-control takes seconds to load

    process = process_of(scenario)
    if (response := analysis.response(settings, process)) is None:
        return
    margin = analysis.margins(response, process).gain
    if margin < 1:
        raise ConfigError(
            f"{name} is unstable with these values: gain margin {margin:.2f}, above 1 needed, with "
            f"{process.gain:.2f} rad of error per rad of handle and {process.dead_s:.2f} s of dead "
            "time",
            "use lower gains, or --force",
        )


def process_of(scenario: Scenario) -> Process:
    """Return the linear picture of a task: its distance and latency."""
    gain = image_gain(SectionGeometry(), scenario.board.distance_m)
    return Process(gain=gain, dead_s=scenario.camera.latency_s + HOLD_S)


def perform(
    request: Request, *, label: str = "", show_progress: bool = True
) -> tuple[dict[str, Any], Path]:
    """Run, score, and complete the run folder.

    Args:
        request: what to run.
        label: stands before the progress bar.
        show_progress: whether there is a progress bar.

    Returns:
        The run record and the run folder.

    Raises:
        ConfigError: the request cannot be carried out; nothing was written.
        HardwareError: the handles stopped; the folder holds everything up to there.
    """
    scenario, instrument, settings, _, bench = resolve(request)
    rig, eyes = rigs.make(
        request.rig,
        scenario,
        vision=request.vision,
        instrument=instrument,
        seed=request.seed,
        overview=True,
        select=selection(request.select),
        bench=bench,
    )
    with closing() as asked, rig:
        if asked:
            raise KeyboardInterrupt
        controller = registry.make(request.controller, rig.camera.calibration, settings, rig.truth)
        law = Path(request.controller).stem
        name = f"{scenario.name}-{law}"
        path = request.out or run_folder.new_path(Path("runs"), name)
        configuration = {
            "run": {k: v for k, v in _request_values(request).items() if k not in UNRECORDED},
            **rig.describe(),
        }
        folder = run_folder.RunFolder(path, configuration)
        if rig.line:
            rig.line.record(path / run_folder.BUS_LOG)
        start = time.perf_counter()
        try:
            with progress(f"{label} {name}".strip(), scenario.duration_s, show_progress) as tell:
                result = loop.run(
                    rig,
                    eyes,
                    controller,
                    duration_s=scenario.duration_s,
                    recorder=folder,
                    progress=tell,
                )
        finally:
            folder.close()
        wall_s = time.perf_counter() - start
        ran_s = result.ticks[-1].t - result.ticks[0].t if result.ticks else 0.0
        record = {
            "scenario": scenario.name,
            "controller": law,
            "variation": overrides.label(request.vary),
            "rig": request.rig,
            "instrument": request.instrument,
            "vision": request.vision,
            "seed": request.seed,
            "duration_s": ran_s,
            "scored_from_s": scenario.scored_from_s,
            "wall_s": wall_s,
            "real_time_factor": ran_s / wall_s,
            "latency_s": scenario.camera.latency_s,
            "interrupted": result.interrupted,
            **metrics.score(result, rig.camera.calibration, scenario.scored_from_s).as_dict(),
        }
    record |= _rivals(scenario, instrument, request.seed, None if bench else ran_s)
    folder.finish(record)
    return record, path


def _rivals(
    scenario: Scenario, instrument: Instrument, seed: int, ran_s: float | None
) -> dict[str, Any]:
    """Return what the path needs and what the best constant handle scores.

    Args:
        scenario: the task.
        instrument: what was steered.
        seed: of the run.
        ran_s: how far it came [s]; None on a bench, whose path is not known.
    """
    if ran_s is None or ran_s <= scenario.scored_from_s:
        return {"needed_tip_deg": None, "constant_px": None}
    ran = scenario.model_copy(update={"duration_s": ran_s})
    path = hindsight(ran, instrument, seed)
    return {
        "needed_tip_deg": list(path.needed_tip_deg),
        "constant_px": path.constant_px and asdict(path.constant_px),
    }


def _request_values(request: Request) -> dict[str, Any]:
    values = dataclasses.asdict(request)
    return {k: str(v) if isinstance(v, Path) else v for k, v in values.items()}
