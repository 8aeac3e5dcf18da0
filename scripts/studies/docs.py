"""`./run docs`: regenerates everything in docs/ and models/ that is generated."""

from __future__ import annotations

import dataclasses
import json
import sys
import tempfile
from itertools import product
from math import degrees, radians
from pathlib import Path

import numpy as np
from rich.console import Console

from endolock.control.identification.cable_parameters import figures
from endolock.control.identification.fits import fit
from endolock.control.identification.handle_log import HandleLog
from endolock.control.scores import ErrorSummary
from endolock.control.transmission.quasi_static import Geometry
from endolock.scripts import cli, demo
from endolock.scripts.figures import hysteresis_figure, strip
from endolock.scripts.runs import record_table, rigs
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.hysteresis_measurement import HysteresisMeasurement
from endolock.scripts.runs.instrument_fit import InstrumentFit
from endolock.scripts.runs.markdown_table import markdown_table
from endolock.scripts.runs.run_record import RunRecord
from endolock.scripts.studies import (
    ablation,
    api_page,
    controller_benchmark,
    controller_calibration,
    ensemble,
    internal_models,
    questions,
    verification,
    vision_docs,
)
from endolock.scripts.thesis import chapter_figures, chapter_runs, statements
from endolock.twin.model import generate
from endolock.twin.physics.surrogate_plant import bend_of
from endolock.twin.world import instrument_files, scenario
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.instrument_cable import cable_of

ROOT = Path(__file__).resolve().parents[2]
END = "<!-- end -->"
PICTURED = ("straight", "circle", "random", "close", "endoscope", "rest")
"""Scenarios run with pictures; all others are run with exact projections."""
COMPARED = demo.LAWS
STRIPS = {"straight": ("strip.png", COMPARED), "endoscope": ("endoscope.png", COMPARED[-1:])}
"""Strips of pictures by scenario: file, and the controllers that are shown."""
HEADINGS = (
    *("scenario", "law", "rms px", "p95 px", "max px", "seen rms px", "vision rms px"),
    *("tip deg", "handle deg", "lost", "start rms px", "start max px"),
    *("travel rad/s", "large reversals /s", "fast"),
)
HEAD = f"""# Results

Written by `./run docs`; seed 0, latency 0.4 s, 640x480 px at f = 262 px. Runs of
{demo.DURATION_S:g} s, of which the first {demo.LEARNT_S:g} s are for the controllers to learn:
*start* is the error in them, and all else is of the rest. *rms*, *p95* and *max* refer to the true
error at every control tick, *seen* to the error that vision saw, 0.4 s old. *tip* and *handle* are
their peak-to-peak motion, on the axis that moved more; *travel*, *large reversals*, by 0.1 rad, and
*fast*, the share of the time above 2 rad/s, are of both handles together. `still` holds the handles
at their initial angles, *constant* is the best result of a constant handle angle, known in
hindsight, `pi_hc` the simple controller with the least error on `straight`, and `predictive_bank`
the lock. Nothing here was measured on an endoscope. [benchmark.md](benchmark.md) has more
controllers, disturbances and plants, and says where the lock loses.
"""
WITHOUT_PICTURES = """## Every scenario from its start, without pictures

With `--vision truth`, vision free of error, over the duration that the scenario's file gives, start
included: the controllers learn meanwhile. The gains of `pi_hc` are valid for 12 cm.
"""


def main(_args: list[str]) -> int:
    """Regenerate the models and their card, and the figures and pictures in docs/."""
    console = Console(stderr=True)
    (ROOT / "docs" / "api.md").write_text(api_page.page(), encoding="utf-8")
    console.print("models")
    generate.main()
    models = generate.folder().parent
    (models / "instruments" / "pretensioned.toml").write_text(pretensioned(), encoding="utf-8")
    (models / "scenarios" / "schema.json").write_text(schema(), encoding="utf-8")
    card = generate.folder() / "README.md"
    text = _between(card.read_text(encoding="utf-8"), "parameters", parameters())
    with console.status("running the checks of the model card"):
        text = _between(text, "verification", verified())
    card.write_text(text, encoding="utf-8")

    with console.status("measuring and fitting for docs/identify.md"):
        guide = ROOT / "docs" / "identify.md"
        text = _between(guide.read_text(encoding="utf-8"), "own", identified())
        text = _between(text, "foreign", misfitted())
    guide.write_text(text, encoding="utf-8")
    with console.status("measuring for docs/vision.md"):
        vision_docs.write(ROOT / "docs", _between)
    with console.status("repeating the runs of the thesis for docs/control.md"):
        answered()
    with console.status("running the predictive lock for docs/predictive.md"):
        guide = ROOT / "docs" / "predictive.md"
        text = guide.read_text(encoding="utf-8")
        text = _between(text, "ensemble", ensemble.table(("pi_simc", "predictive_bank")))
        text = _between(text, "ablation", ablation.table())
        text = _between(text, "models", internal_models.table())
        guide.write_text(text, encoding="utf-8")
    with console.status("running the benchmark of the controllers, some minutes"):
        (ROOT / "docs" / "benchmark.md").write_text(controller_benchmark.page(), encoding="utf-8")
    with tempfile.TemporaryDirectory() as temporary:
        record = HysteresisMeasurement(map=True, out=Path(temporary) / "log").run(
            show_progress=True
        )
    hysteresis_figure.draw(record, ROOT / "docs" / "hysteresis.png")

    with console.status("running the controllers with pictures, some minutes"):
        results(ROOT / "docs")
    return 0


def results(folder: Path) -> None:
    """Run `COMPARED` on every scenario; write results.md and the strips of pictures."""
    records, fast = [], []
    learnt = demo.DURATION_S, demo.LEARNT_S
    for name in PICTURED:
        with tempfile.TemporaryDirectory() as temporary:
            runs = {law: Path(temporary) / law for law in COMPARED}
            records += [_run(name, law, "markers", out, learnt) for law, out in runs.items()]
            if name in STRIPS:
                file, shown = STRIPS[name]
                strip.write({law: runs[law] for law in shown}, folder / file, demo.LEARNT_S)
    for name, law in product(scenario.names(), COMPARED):
        with tempfile.TemporaryDirectory() as temporary:
            fast.append(_run(name, law, "truth", Path(temporary) / "run"))
    text = f"{HEAD}\n{_markdown(records)}\n{WITHOUT_PICTURES}\n{_markdown(fast)}"
    (folder / "results.md").write_text(text, encoding="utf-8")


def parameters() -> str:
    """Return the defaults of an instrument with grade, meaning and source, as Markdown."""
    rows = []
    defaults = dataclasses.asdict(Instrument())
    for name, meaning in instrument_files.meanings().items():
        grade = "C" if "ssumed" in meaning else "B"
        rows.append([f"`{name}`", f"{defaults[name]:.6g}", grade, meaning])
    return markdown_table(["parameter", "default", "grade", "meaning and source"], rows, "lrll")


def pretensioned() -> str:
    """Return the instrument file of the defaults."""
    header = (
        "The default: wires under tension. Written by ./run docs from twin/world/instrument.py."
    )
    return instrument_files.dump(Instrument(), header)


def verified() -> str:
    """Run all checks of the twin and return their table as Markdown."""
    rows = []
    for check in verification.CHECKS:
        figure = f"{check.measure():.3g} {check.unit}".strip()
        rows.append([check.what, check.against, figure, verification.bounds(check), check.why])
    return markdown_table(
        ["what", "against", "figure", "bound", "reason for the bound"], rows, "llrll"
    )


def identified() -> str:
    """Fit logs of our own instruments; return true and identified parameters as Markdown."""
    rows = []
    for name in ("pretensioned", "slack"):
        with tempfile.TemporaryDirectory() as temporary:
            log = Path(temporary) / "log"
            HysteresisMeasurement(instrument=name, noise_deg=0.1, out=log).run()
            record = InstrumentFit(log=log).run()
        made = instrument_files.load(name)
        true = figures(cable_of(made, radians(record.shaft_deg)))
        for key, found in record.params.items():
            known = "" if found.determined else "not determined"
            cells = (f"{true[key]:.4g}", f"{found.value:.4g}", f"{found.std:.2g}")
            rows.append([name, f"`{key}`", *cells, known])
        held, play = record.heldout_rms_deg, record.play_heldout_rms_deg
        rows.append([name, f"held out, deg rms (a play: {play:.2f})", "", f"{held:.2f}", "", ""])
    head = ["instrument", "parameter", "true", "found", "+-", ""]
    return markdown_table(head, rows, "llrrrl")


def misfitted() -> str:
    """Fit logs of two plants without wires; return the residuals as Markdown."""
    rows = []
    t = np.arange(0.0, 130.0, 0.02)
    handle = 2.0 * (1 - np.abs((0.1 * t + 1) % 4 - 2))
    noise = np.radians(0.1) * np.random.default_rng(0).standard_normal(len(t))
    nothing = np.zeros(len(t))
    for name in ("bouc_wen", "prandtl_ishlinskii"):
        bend = np.column_stack([bend_of(rigs.FIXED[name][0], handle) + noise, nothing])
        found = fit(HandleLog(t, np.column_stack([handle, nothing]), bend), Geometry())
        errors = (found.fit_rms_rad, found.heldout_rms_rad, found.play_heldout_rms_rad)
        cells = [f"{degrees(error):.2f} deg" for error in errors]
        known = ", ".join(n for n, p in found.params.items() if p.determined) or "nothing"
        rows.append([name, *cells, known])
    head = ["plant", "fitted part", "held out", "best play, held out", "determined"]
    return markdown_table(head, rows, "lrrrl")


def answered() -> None:
    """Regenerate the tables and figures of docs/control.md."""
    page = ROOT / "docs" / "control.md"
    text = page.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as temporary:
        _, runs = chapter_runs.perform(Path(temporary) / "runs", "markers")
    folder = ROOT / "docs" / "thesis"
    folder.mkdir(exist_ok=True)
    for picture in chapter_figures.draw(runs, folder):
        picture.with_suffix(".csv").unlink()  # written by the command only
    text = _between(text, "calibration", controller_calibration.table())
    text = _between(text, "thesis", chapter_runs.markdown(statements.ask(runs)))
    folder = ROOT / "docs" / "control"
    folder.mkdir(exist_ok=True)
    for name, question in questions.questions().items():
        answer = question()
        questions.save(answer, folder / f"{name}.png")
        text = _between(text, name, answer.table)
    page.write_text(text, encoding="utf-8")


def schema() -> str:
    """Return the JSON Schema of scenario files as text."""
    return json.dumps(scenario.schema(), indent=2) + "\n"


def _between(text: str, name: str, content: str) -> str:
    """Replace the text between the mark of that name and the next end mark."""
    start = f"<!-- {name} -->\n"
    before, rest = text.split(start, 1)
    return f"{before}{start}{content}{END}{rest.split(END, 1)[1]}"


def _run(
    name: str, controller: str, eyes: str, out: Path, times: tuple[float, float] | None = None
) -> RunRecord:
    """Run a controller; `times` are duration and start of the scores, else the scenario's [s]."""
    duration_s, scored_from_s = times or (None, None)
    experiment = Experiment(
        scenario=name,
        controller=controller,
        vision=eyes,
        duration_s=duration_s,
        scored_from_s=scored_from_s,
        out=out,
    )
    return experiment.run(show_progress=True)


def _markdown(records: list[RunRecord]) -> str:
    rows = []
    for r in record_table.with_constants(records):
        error, seen, vision = r.error_px, r.delayed_error_px, r.vision_error_px
        assert error
        assert r.tip
        lost, start = r.lost_fraction, r.startup_error_px or ErrorSummary()
        large, fast = r.handle.large_reversals_per_s, r.handle.fast_share
        row = [
            r.scenario,
            r.controller,
            *(f"{value:.1f}" for value in (error.rms, error.p95, error.max)),
            f"{seen.rms:.1f}" if seen.rms is not None else "",
            f"{vision.rms:.2f}" if vision else "",
            *(f"{max(motion.p2p_deg or []):.0f}" for motion in (r.tip, r.handle)),
            "" if lost is None else f"{100 * lost:.1f} %",
            *("" if value is None else f"{value:.1f}" for value in (start.rms, start.max)),
            *("" if value is None else f"{value:.2f}" for value in (r.travel_rad_s, large)),
            "" if fast is None else f"{100 * fast:.0f} %",
        ]
        rows.append(row)
    return markdown_table(HEADINGS, rows, "ll" + "r" * (len(HEADINGS) - 2))


if __name__ == "__main__":
    sys.exit(cli.guarded(main, sys.argv[1:]))
