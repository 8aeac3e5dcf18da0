"""Calibration of the controllers for the thesis' runs: on which statements, and what was tried.

* kp and ki of `pi`: on T1 and T2, both columns, with the tip following by half or more and a gain
  margin of 1.5. Of the pairs of a grid, the one for which most of these four statements hold, and
  then the one that misses the others by least.
* the rate of `ik`: on T4 in column b, the slowest of a grid for which it holds.
* the switch-off speed of compensation: on no statement. The smallest for which the axis whose
  target rests does not ring, with those gains, at `NOISE_PX`.

`./run python -m endolock.scripts.studies.controller_calibration` prints the tables of
docs/control.md; 2 minutes.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from endolock.control import analysis
from endolock.control.laws.pi import PISettings
from endolock.scripts import cli
from endolock.scripts.runs import batch, theory
from endolock.scripts.runs.batch import FOLLOWED
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.markdown_table import markdown_table
from endolock.scripts.runs.run_record import RunRecord
from endolock.scripts.thesis import chapter_runs
from endolock.scripts.thesis.chapter_runs import COLUMNS, STROKE_S, Trace
from endolock.scripts.thesis.statements import GAIN_PX, PEAK_PX, gain_px, needed_deg, straight_ik

KP = (0.0, 0.1, 0.2, 0.3, 0.4)
KI = tuple(round(0.2 * n, 1) for n in range(1, 11))
RATES_PER_S = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
SWITCH_OFF_RAD_S = (0.005, 0.01, 0.02, 0.05)
LEAST_MARGIN = 1.5
"""Gain margin of every controller with its defaults, at least."""
NOISE_PX = 1.0
"""Noise of vision [px]: ten times that of markers (docs/vision.md)."""
RESTS_DEG = 2.0
"""A handle that moves less is at rest [deg]: noise of 1 px alone moves it by 0.4 to 1.0 deg."""
SEEDS = tuple(range(6))
"""Seeds of that noise; the worst result counts."""
SHOWN = 6
"""Rows of the table of gains."""


class GainPair(NamedTuple):
    """Result of one pair of gains."""

    kp: float
    ki: float
    margin: float
    """Gain margin [1]."""
    peak_px: dict[str, float]
    """By column."""
    gain_px: dict[str, float]
    tip_deg: float
    """Peak-to-peak motion of the twin's tip after two strokes [deg]."""

    @property
    def misses_px(self) -> list[float]:
        """Distances of T1 and T2 from their bounds, both columns [px]; 0 inside."""
        bounded = [(self.peak_px[c], PEAK_PX[c]) for c in COLUMNS]
        bounded += [(self.gain_px[c], GAIN_PX) for c in COLUMNS]
        return [max(low - value, value - high, 0.0) for value, (low, high) in bounded]

    @property
    def rank(self) -> tuple[int, float]:
        """Sort key: statements missed, and by how much [px]; the smallest is the best."""
        return sum(miss > 0 for miss in self.misses_px), sum(self.misses_px)


def pairs() -> list[GainPair]:
    """Try all gains with enough margin; return those for which the tip follows, best first."""
    task = chapter_runs.experiment("b", "straight", "pi").resolve()
    process = theory.process_of(task.scenario)
    tried = []
    for kp, ki in product(KP, KI):
        response = analysis.response(PISettings(kp=kp, ki=ki), process)
        assert response is not None
        margin = analysis.margins(response, process).gain
        if margin >= LEAST_MARGIN:
            tried.append((kp, ki, margin))
    cases = [
        (column, law, (f"law.kp={kp}", f"law.ki={ki}"))
        for kp, ki, _ in tried
        for column in COLUMNS
        for law in ("pi", "pi_hc")
    ]
    traces = iter(
        _traces([chapter_runs.experiment(c, "straight", law, gains) for c, law, gains in cases])
    )
    found = []
    for kp, ki, margin in tried:
        runs = {c: {f"straight-{law}": next(traces) for law in ("pi", "pi_hc")} for c in COLUMNS}
        peaks = {c: float(runs[c]["straight-pi"].total.max()) for c in COLUMNS}
        gains = {c: gain_px(runs[c]) for c in COLUMNS}
        tip = runs["b"]["straight-pi"].tip_deg(2 * STROKE_S)
        found.append(GainPair(kp, ki, margin, peaks, gains, tip))
    low, high = (share * needed_deg() for share in FOLLOWED)
    return sorted((one for one in found if low <= one.tip_deg <= high), key=lambda p: p.rank)


def rates() -> dict[float, tuple[str, bool]]:
    """Test T4 in column b for each rate; return the result and whether it holds."""
    experiments = [chapter_runs.experiment("b", "straight", law) for law in ("pi", "pi_hc")]
    experiments += [
        chapter_runs.experiment("b", "straight", "ik", (f"law.rate_per_s={rate}",))
        for rate in RATES_PER_S
    ]
    pi, hc, *inverse = _traces(experiments)
    found = {}
    for rate, ik in zip(RATES_PER_S, inverse, strict=True):
        runs = {"straight-pi": pi, "straight-pi_hc": hc, "straight-ik": ik}
        verdict = straight_ik(runs, "b")
        found[rate] = verdict.got, bool(verdict.ok)
    return found


def switch_offs() -> dict[float, float]:
    """Return the largest motion of the resting axis' handle for each switch-off speed [deg]."""
    noise = f"camera.truth_noise_px={NOISE_PX}"
    experiments = [
        replace(
            chapter_runs.experiment(
                "b", "straight", "pi_hc", (f"law.switch_off_rad_s={speed}", noise)
            ),
            seed=seed,
        )
        for speed in SWITCH_OFF_RAD_S
        for seed in SEEDS
    ]
    moved = np.array([np.ptp(trace.handle[:, 0]) for trace in _traces(experiments)])
    worst = moved.reshape(len(SWITCH_OFF_RAD_S), len(SEEDS)).max(axis=1).tolist()
    return dict(zip(SWITCH_OFF_RAD_S, worst, strict=True))


def table() -> str:
    """Run the calibration and return its tables as Markdown."""
    rows = [
        [
            f"{one.kp:g}, {one.ki:g}",
            *(f"{one.peak_px[c]:.0f}" for c in COLUMNS),
            *(f"{one.gain_px[c]:.0f}" for c in COLUMNS),
            f"{4 - one.rank[0]} of 4, {one.rank[1]:.1f} px",
            f"{one.tip_deg:.0f} deg",
            f"{one.margin:.2f}",
        ]
        for one in pairs()[:SHOWN]
    ]
    heads = ["kp, ki", *(f"T1{c} [px]" for c in COLUMNS), *(f"T2{c} [px]" for c in COLUMNS)]
    text = markdown_table([*heads, "hold, missed by", "tip", "gain margin"], rows)
    rows = [[f"{rate:g}/s", got, "yes" if ok else "no"] for rate, (got, ok) in rates().items()]
    text += "\n" + markdown_table(["rate of `ik`", "T4, our twin", "holds"], rows)
    rows = [[f"{speed:g} rad/s", f"{moved:.1f} deg"] for speed, moved in switch_offs().items()]
    head = ["switch-off", f"handle of the resting axis, p-p, worst of {len(SEEDS)} seeds"]
    return f"{text}\n{markdown_table(head, rows)}"


def _traces(experiments: list[Experiment]) -> list[Trace]:
    return batch.each_of(experiments, _trace)


def _trace(_record: RunRecord, folder: Path) -> Trace:
    return chapter_runs.trace(folder)


def main(_args: list[str]) -> int:
    """Print the tables."""
    print(table())
    return 0


if __name__ == "__main__":
    sys.exit(cli.guarded(main, sys.argv[1:]))
