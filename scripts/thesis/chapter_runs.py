"""The runs of the excerpt's chapter 6, repeated for `endolock compare --thesis`.

Column a, our simulation, has wires with friction and without inertia, and exact kinematics: a loop
whose width depends on both bends, with friction as in eq. 3.29. Column b, our twin, stands for the
set-up. Both use the instrument `thesis` with a straight shaft; the camera has 720x576 px; runs take
25 s (circle 20 s) and are scored from the start, on what vision saw.

kp and ki were calibrated on T1 and T2, and the rate of inverse kinematics on T4 in column b, see
scripts/studies/controller_calibration.py; the width of compensation is the excerpt's own 0.2.
Everything else is a prediction. A parameter that was changed to provoke an effect is marked as
such, and proves nothing.

Reference:
    S. D. Frijnts, Design of a target lock for an endoscope using TeleFLEX, University of Twente,
    2015: chapters 6 to 8 (excerpt) and section 4.2, p. 31 (the endoscope lies straight, there is
    hardly any deadband, compensation is added to the steering set-point).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from endolock.hw.api import Vector
from endolock.scripts.runs import run_folder
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.markdown_table import markdown_table
from endolock.scripts.runs.series import Series, run_all

INSTRUMENT = "thesis"
SET_UP = ("camera.width=720", "camera.height=576", "shaft_bend_deg=0")
"""Camera assumed: PAL, f = 314 px at 85 deg."""
IK_RATE = "law.rate_per_s=3.5"
"""Calibrated on T4 in column b alone: the slowest of 1, 1.5, ... for which T4 holds. Its gain
margin is about 1: unsuitable for other runs."""
LAWS = ("still", "pi", "pi_hc", "ik")
CHANGED = {"ik": (IK_RATE,)}
"""Settings that these runs change, by controller."""
COLUMNS = {"a": "quasi_static", "b": "twin"}
DURATION_S = {"straight": 25.0, "circle": 20.0}
FRICTIONLESS = ("instrument.conduit_friction=0", "instrument.section_friction=0")
LATENCY_S = 0.4
LATENCIES_S = (0.0, 0.2)
"""Other latencies that are run [s]."""
EXTRA: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "over": ("straight", "pi_hc", ("law.width=0.3",)),
    "free": ("straight", "pi", FRICTIONLESS),
    "known": ("straight", "ik", ("law.measured_distance=true",)),
    **{
        f"straight-{law}-{latency:g}s": ("straight", law, (f"camera.latency_s={latency:g}",))
        for law in LAWS[1:]
        for latency in LATENCIES_S
    },
}
"""A width 1.5 times as large, no friction, a known distance, less latency; by name: scenario,
controller, changes."""
EXPOSURE_S = 0.020
"""Exposure for which blur is computed from the motion of the image [s]: a field of PAL. Assumed;
the pictures of these runs have none."""
STROKE_S = 4.3
"""Time between two reversals of the target [s]."""


class Trace(NamedTuple):
    """Time series of one run, as in the plots of the thesis."""

    t: Vector
    """Delivery times of the frames [s]."""
    error: Vector
    """Offset of the target in these frames, n x 2, right and down [px]."""
    handle_t: Vector
    """Times of the control ticks [s]."""
    handle: Vector
    """Measured handle angles, m x 2 (up_down, left_right) [deg]."""
    compensation: Vector
    """Compensation added to the handle angles, m x 2 [deg]; 0 if there is none."""
    bend: Vector
    """True bends of the tip, m x 2 [deg]."""
    blur_px: float
    """Mean image motion of the target within `EXPOSURE_S`, over the whole run [px]."""

    @property
    def total(self) -> Vector:
        """Distance of the target from the image centre [px]."""
        distance: Vector = np.hypot(*self.error.T)
        return distance

    def breaks(self) -> Vector:
        """Second differences of the distance between frames [px]: large at discontinuities."""
        return np.diff(self.total, 2)

    def tip_deg(self, start_s: float = 0.0) -> float:
        """Peak-to-peak motion of the tip on the axis that moves more [deg]."""
        return float(np.ptp(self.bend[self.handle_t >= start_s], axis=0).max())

    def strokes(self) -> Vector:
        """Largest delayed error of each complete stroke [px]; NaN if the target was never seen."""
        ends = np.arange(LATENCY_S, self.handle_t[-1] - STROKE_S, STROKE_S)
        parts = [(self.t >= a) & (self.t < a + STROKE_S) for a in ends]
        return np.array([self.total[part].max() if part.any() else np.nan for part in parts])

    def turns(self, axis: int, least_deg: float = 5.0) -> list[tuple[float, float, float]]:
        """Motions of a handle between reversals: start, end and distance [s, s, deg]."""
        h = self.handle[:, axis]
        indices = [0]
        direction = 0.0
        for n in range(1, len(h)):
            last = indices[-1]
            if direction == 0.0 or (h[n] - h[last]) * direction < -least_deg:
                if abs(h[n] - h[last]) > least_deg:
                    direction = float(np.sign(h[n] - h[last]))
                    indices.append(n)
            elif (h[n] - h[last]) * direction > 0:
                indices[-1] = n
        return [
            (float(self.handle_t[a]), float(self.handle_t[b]), float(abs(h[b] - h[a])))
            for a, b in pairwise(indices)
        ]


Runs = dict[str, dict[str, Trace]]
"""Traces by column and by SCENARIO-CONTROLLER or the name of an extra run."""


def perform(folder: Path, vision: str) -> tuple[Series, Runs]:
    """Carry out all runs.

    Args:
        folder: where the run folders are written; new or empty.
        vision: kind of vision for column b.

    Returns:
        The runs, complete or up to an interruption, and the traces.
    """
    traces = Runs()
    listed = list(experiments(folder, vision))
    series = run_all([experiment for *_, experiment in listed])
    for (column, name, _), record in zip(listed, series.records, strict=False):
        if not record.interrupted:
            traces.setdefault(column, {})[name] = trace(record.folder)
    return series, traces


def experiments(folder: Path, vision: str) -> Iterator[tuple[str, str, Experiment]]:
    """Yield column, name and experiment of every run."""
    for column in COLUMNS:
        plain = {f"{s}-{law}": (s, law, ()) for s in DURATION_S for law in LAWS}
        for name, (scenario, law, changes) in {**plain, **EXTRA}.items():
            out = folder / f"{column}-{name}"
            yield column, name, experiment(column, scenario, law, changes, vision, out)


def experiment(
    column: str,
    scenario: str,
    controller: str,
    changes: Iterable[str] = (),
    vision: str = "truth",
    out: Path | None = None,
) -> Experiment:
    """Describe one run of the thesis' set-up.

    Args:
        column: one of `COLUMNS`.
        scenario: one of `DURATION_S`.
        controller: its name.
        changes: to scenario, instrument and controller; they come last.
        vision: kind of vision for column b.
        out: run folder to write.
    """
    return Experiment(
        scenario=scenario,
        controller=controller,
        rig=COLUMNS[column],
        vision="truth" if column == "a" else vision,
        instrument=INSTRUMENT,
        vary=(*SET_UP, *CHANGED.get(controller, ()), *changes),
        duration_s=DURATION_S[scenario],
        scored_from_s=0.0,
        force=True,
        out=out,
    )


def trace(folder: Path) -> Trace:
    """Read the trace of a run folder."""
    frames, ticks = run_folder.read(folder, "frames"), run_folder.read(folder, "ticks")
    centre = run_folder.configuration(folder)["calibration"]["centre_px"]
    seen = np.array(frames["status"]) == "tracking"
    pixels = np.array(frames["target_px"].to_pylist(), float)[seen]
    moves = np.diff(np.array(ticks["target_px"].to_pylist(), float), axis=0)
    speeds = np.hypot(*moves.T) / np.diff(np.array(ticks["t"]))
    inside = [dict(row or ()) for row in ticks["signals"].to_pylist()]
    names = [f"compensation_{axis}_rad" for axis in ("up_down", "left_right")]
    return Trace(
        np.array(frames["t_available"])[seen],
        pixels - centre,
        np.array(ticks["t"]),
        np.degrees(np.array(ticks["position_rad"].to_pylist())),
        np.degrees([[row.get(name, 0.0) for name in names] for row in inside]),
        np.degrees(np.array(ticks["bend_rad"].to_pylist())),
        EXPOSURE_S * float(np.mean(speeds[np.isfinite(speeds)])),
    )


def layout(rows: list[dict[str, Any]]) -> Iterator[str | Table]:
    """Format the answered statements for a terminal, those that do not hold first."""
    yield "[bold]The excerpt's statements[/]; a: our simulation, b: our twin; --: not stated"
    answers = {None: "[dim]--[/]", True: "[green]yes[/]", False: "[red]NO[/]"}
    names = sorted(
        dict.fromkeys(row["id"] for row in rows),
        key=lambda name: all(row["ok"] is not False for row in rows if row["id"] == name),
    )
    for name in names:
        own = [row for row in rows if row["id"] == name]
        yield f"\n[bold]{name}[/] {own[0]['statement']}"
        table = Table.grid(padding=(0, 1, 0, 0), pad_edge=True)
        table.add_column(width=2, justify="right")
        table.add_column(width=3)
        table.add_column()
        for row in own:
            table.add_row(row["column"], answers[row["ok"]], row["got"])
            expected = f"{row['basis']}; expected: {row['expected'] or 'not stated'}"
            table.add_row("", "", f"[dim]{expected}[/]")
        yield table
    for basis in ("predicted", "calibrated", "provoked"):
        judged = [row for row in rows if row["basis"] == basis and row["ok"] is not None]
        held = sum(row["ok"] for row in judged)
        yield ("\n" if basis == "predicted" else "") + f"{basis}: {held} of {len(judged)} hold"


def markdown(rows: list[dict[str, Any]]) -> str:
    """Format the answered statements for docs/control.md, those that do not hold first."""
    head = ["", "", "statement", "expected", "got", "holds", "basis"]
    answers = {None: "not stated", True: "yes", False: "**no**"}
    ordered = sorted(rows, key=lambda row: (row["ok"] is not False, row["ok"] is None))
    body = [
        [
            *(r["id"], r["column"], r["statement"], r["expected"] or ""),
            *(r["got"], answers[r["ok"]], r["basis"]),
        ]
        for r in ordered
    ]
    return markdown_table(head, body, "l" * len(head))
