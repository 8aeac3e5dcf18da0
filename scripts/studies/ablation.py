"""Ablation of the predictive lock: error and turns of the handles with one mechanism removed.

`./run python -m endolock.scripts.studies.ablation` prints the table of docs/predictive.md; a
quarter of an hour.
"""

from __future__ import annotations

import sys
from typing import NamedTuple

from endolock.scripts import cli
from endolock.scripts.runs import batch
from endolock.scripts.runs.batch import FinishedRun
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.markdown_table import markdown_table

LOST = 0.01
"""Share of the time out of sight above which a cell says so [1]: more than the start of a run."""
WITHOUT: dict[str, tuple[str, tuple[str, ...]]] = {
    "nothing": ("predictive_bank", ()),
    "background": ("predictive_bank", ("law.background=false",)),
    "regression": ("predictive_bank", ("law.regression=false",)),
    "harmonic": ("predictive_bank", ("law.harmonic=false",)),
    "dead zones": ("predictive_bank", ("law.dead_zones=false",)),
    "capstan": ("predictive_bank", ("law.capstan=false",)),
    "capstan and background": ("predictive_bank", ("law.capstan=false", "law.background=false")),
    "all but one predictor (`predictive`)": ("predictive", ()),
}
"""Law and settings of each row, by what is missing."""


class Case(NamedTuple):
    """One column of the table."""

    scenario: str
    vary: tuple[str, ...] = ()
    """What differs from the scenario."""
    rig: str = "twin"


CASES: dict[str, Case] = {
    "straight": Case("straight"),
    "circle": Case("circle"),
    "triangle": Case("triangle"),
    "random": Case("random"),
    "breathing": Case("breathing"),
    "drift": Case("drift"),
    "latency 30 % off": Case("straight", ("latency_more",)),
    "dead zone": Case("circle", rig="dead_zone"),
    "Bouc-Wen": Case("circle", rig="bouc_wen"),
}
"""`dead zone` and `Bouc-Wen` are plants of other kinds, on `circle`."""


def experiment(law: str, changes: tuple[str, ...], case: Case) -> Experiment:
    """Describe one run: a row of `WITHOUT` on a column of `CASES`."""
    return Experiment(
        scenario=case.scenario,
        controller=law,
        vision="truth",
        rig=case.rig,
        vary=(*changes, *case.vary, "camera.truth_noise_px=0.3"),
        duration_s=100.0,
        scored_from_s=50.0,
    )


def table() -> str:
    """Run every case and return the table as Markdown."""
    experiments = [
        experiment(law, changes, case)
        for law, changes in WITHOUT.values()
        for case in CASES.values()
    ]
    done = batch.all_of(experiments)
    count = len(CASES)
    rows = [
        [name, *(_cell(one) for one in done[n * count :][:count])] for n, name in enumerate(WITHOUT)
    ]
    return markdown_table(["without", *CASES], rows)


def _cell(one: FinishedRun) -> str:
    """Rms error [px] and large reversals of both handles [1/s]."""
    _, large, _ = one.handles
    return f"{one.rms:.1f} / {large:.2f}" + (" (lost)" if one.lost > LOST else "")


def main(_args: list[str]) -> int:
    """Print the table."""
    print(table())
    return 0


if __name__ == "__main__":
    sys.exit(cli.guarded(main, sys.argv[1:]))
