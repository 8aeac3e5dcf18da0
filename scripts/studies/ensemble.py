"""An ensemble of plants that the predictive controller does not know.

Each plant is drawn from a seed: parameters within 30 %, latency, angle of the camera. Seeds 0 to 19
are for tuning; `SEEDS`, the seeds of the reported figures, were fixed before any tuning and have no
other use.

`./run python -m endolock.scripts.studies.ensemble [CONTROLLER ...]` prints the table of
docs/predictive.md; minutes.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from endolock.scripts import cli
from endolock.scripts.runs import batch
from endolock.scripts.runs.batch import FinishedRun
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.markdown_table import markdown_table

SEEDS = tuple(range(100, 120))
VARIED = (
    "bending_stiffness",
    "damping_time_s",
    "section_mass_kg",
    "tip_mass_kg",
    "wire_stiffness",
    "slack_m",
    "conduit_friction",
    "section_friction",
    "residual_wrap_rad",
    "pulley_radius_m",
    "handle_kp",
    "handle_kv",
)
"""Parameters of the instrument that vary; lengths are not among them, a ruler measures them."""
VARIATION = 0.3
"""Largest relative change of a parameter [1]."""
LATENCY_S = (0.28, 0.52)
"""Range of the latency [s]; the camera reports 0.4 s."""
MISALIGNMENT_DEG = 8.0
"""Largest angle between camera and wires [deg]."""
SCENARIOS = ("straight", "circle")


def plant(seed: int) -> tuple[str, ...]:
    """Return the changes of scenario and instrument that make one plant."""
    from endolock.twin.world.instrument import Instrument

    random = np.random.default_rng(seed)
    nominal = Instrument()
    changes = []
    for name in VARIED:
        above = 0.0 if name == "damping_time_s" else VARIATION  # the upper limit of the twin
        value = getattr(nominal, name) * (1 + random.uniform(-VARIATION, above))
        changes.append(f"instrument.{name}={value:.9g}")
    turn = np.radians(MISALIGNMENT_DEG) * random.uniform(-1, 1)
    changes.append(f"instrument.misalignment_rad={turn:.9g}")
    changes.append(f"camera.latency_s={random.uniform(*LATENCY_S):.4f}")
    return (*changes, "camera.nominal_latency_s=0.4")


def perform(law: str, seeds: Sequence[int] = SEEDS) -> dict[str, list[FinishedRun]]:
    """Run a controller on every plant, 100 s, scored from 50 s; return the runs by scenario."""
    experiments = [
        Experiment(
            scenario=name,
            controller=law,
            vision="truth",
            vary=(*plant(seed), "camera.truth_noise_px=0.3"),
            duration_s=100.0,
            scored_from_s=50.0,
            seed=seed,
        )
        for name in SCENARIOS
        for seed in seeds
    ]
    done = batch.all_of(experiments)
    return {name: done[n * len(seeds) :][: len(seeds)] for n, name in enumerate(SCENARIOS)}


def table(laws: Sequence[str], seeds: Sequence[int] = SEEDS) -> str:
    """Run some controllers; return their median and worst errors as Markdown."""
    rows = []
    for law in laws:
        cells = []
        for runs in perform(law, seeds).values():
            rms = sorted(one.rms for one in runs)
            lost = sum(one.lost > 0 for one in runs)
            cells += [f"{np.median(rms):.1f}", f"{rms[-1]:.1f}", str(lost)]
        rows.append([law, *cells])
    heads = [f"{name}: {what}" for name in SCENARIOS for what in ("median", "worst", "lost")]
    return markdown_table(["law, rms px", *heads], rows)


def main(args: list[str]) -> int:
    """Print the table."""
    print(table(args or ["pi_simc", "predictive_bank"]))
    return 0


if __name__ == "__main__":
    sys.exit(cli.guarded(main, sys.argv[1:]))
