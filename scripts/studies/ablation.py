"""Ablation of the predictive lock: its error with one mechanism removed at a time.

`./run python -m endolock.scripts.studies.ablation` prints the table of docs/predictive.md; about a
minute.
"""

from __future__ import annotations

import sys

from endolock.scripts import cli
from endolock.scripts.runs import batch
from endolock.scripts.runs.batch import FinishedRun
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.markdown_table import markdown_table

NEVER = "law.identify_every_s=1e9"
WITHOUT: dict[str, tuple[str, tuple[str, ...]]] = {
    "nothing": ("predictive_bank", ()),
    "harmonic predictor": ("predictive_bank", ("law.harmonic=false",)),
    "bank (one fast predictor)": ("predictive", ()),
    "identification, and thus prediction": ("predictive_bank", (NEVER,)),
    "capstan model": ("predictive_bank", ("law.capstan=false",)),
    "damped update of the weights": ("predictive_bank", ("law.damping=1.0",)),
    "reference play": ("predictive_bank", ("law.reversal_rad=0.0",)),
    "weighting by handle speed": ("predictive_bank", ("law.latency_uncertainty_s=0.0",)),
    "caution": ("predictive_bank", ("law.busy_per_s=1e9",)),
}
CASES: dict[str, tuple[str, tuple[str, ...]]] = {
    "straight": ("straight", ()),
    "circle": ("circle", ()),
    "triangle": ("triangle", ()),
    "random": ("random", ()),
    "latency 30 % off": ("straight", ("latency_more",)),
    "no hysteresis": ("straight", ("no_hysteresis",)),
}


def table() -> str:
    """Run every case and return the table as Markdown."""
    experiments = [
        Experiment(
            scenario=scenario,
            controller=law,
            vision="truth",
            vary=(*changes, *more, "camera.truth_noise_px=0.3"),
            duration_s=100.0,
            scored_from_s=50.0,
        )
        for law, changes in WITHOUT.values()
        for scenario, more in CASES.values()
    ]
    done = batch.all_of(experiments)
    count = len(CASES)
    rows = [
        [name, *(_cell(one) for one in done[n * count :][:count])] for n, name in enumerate(WITHOUT)
    ]
    return markdown_table(["without, rms px", *CASES], rows)


def _cell(one: FinishedRun) -> str:
    lost = one.lost
    return f"{one.rms:.1f}" + (" (lost)" if lost > 0.01 else "")


def main(_args: list[str]) -> int:
    """Print the table."""
    print(table())
    return 0


if __name__ == "__main__":
    sys.exit(cli.guarded(main, sys.argv[1:]))
