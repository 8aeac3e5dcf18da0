"""The benchmark of the controllers, for docs/benchmark.md, and single parts of it.

    python -m endolock.scripts.studies.controller_benchmark            # the page
    python -m endolock.scripts.studies.controller_benchmark plants     # one part

Runs take 100 s and are scored from 50 s, at f = 262 px, without pictures (a test shows that runs
with pictures give the same result), with one seed. For other combinations use
`endolock compare --vary ... --latencies ...`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from math import ceil

from endolock.hw.errors import ConfigError
from endolock.scripts import cli
from endolock.scripts.runs import batch, overrides, rigs, theory
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.studies.benchmark_tables import (
    MAX_MORE_PX,
    MAX_TIMES,
    RMS_MORE_PX,
    RMS_TIMES,
    SIMPLE,
    Case,
    Part,
    Planned,
    Results,
    losses,
    tables,
)
from endolock.twin.world import scenario

LOCK = "predictive_bank"
"""The law whose losses are listed."""
LAWS = (
    *("still", "pi", "pi_hc", "ik", "pi_simc", "pi_simc_hc", "ik_sync", "smith", "repetitive"),
    *("predictive", LOCK, "oracle"),
)
FEW = ("still", "pi", "pi_simc", "ik_sync", LOCK)
"""Controllers of the larger tables: holding still, and four that move."""
NOMINAL_S = 0.4
LATENCIES = (0.06, 0.2, NOMINAL_S, 0.8)
"""Latencies [s]; runs with that of the scenarios are those of the other parts."""
NOISE_PX = 1.0
"""Noise of vision in front of the plants of other kinds [px]."""
DURATION_S, SCORED_FROM_S = 100.0, 50.0
HEAD = """# Benchmark of the controllers

Written by `./run docs`, within {minutes} minutes on two cores. True error in px, at
f = 262 px and 0.4 s of latency unless stated, 100 s of which the last 50 are scored, seed 0, exact
projections instead of pictures, on a simulated plant: none of this was measured on an endoscope.
`still` holds the handles at their initial angles, and *constant* is the best result of a constant
handle angle, known in hindsight: a controller that is not better has gained nothing by moving the
handles. `oracle` knows the truth and has no latency: it is a lower bound, not a controller. *lost*:
the target was out of sight for more than 1 % of the time; *unstable*: the linear loop is unstable,
as with the gains of `pi`, which are valid for 12 cm and 0.4 s.

Each table of errors is followed by its price. Peak-to-peak motion of tip and handle is that of the
axis that moves more: where the tip moves much less than the path needs, the controller is parked,
and its error is that of a constant handle angle. Travel, reversals and speed are those of both
handles together: a hand would not like to hold one that reverses by 0.1 rad more than once a
second, or turns faster than 2 rad/s.
"""
CLOSING = """
The Wiener floor is a lower bound for every prediction of that random motion, with the latency,
servo lag, 0.03 s of hold, and 0.1 px of noise; other motions have no such bound. Sizes of the
disturbances: [models/disturbances](../models/disturbances); paths of the targets:
[models/scenarios](../models/scenarios); the plants of other kinds:
[twin/physics/foreign_plants.py](../twin/physics/foreign_plants.py). To repeat one row, with margins
and a figure:

    ./run endolock compare --scenarios straight --controllers pi pi_simc --vary width_more \\
        --vision truth --duration-s 100 --scored-from-s 50
"""


def experiment(planned: Planned) -> Experiment:
    """Describe one run of the benchmark."""
    return Experiment(
        scenario=planned.scenario,
        controller=planned.law,
        rig=planned.rig,
        vision="truth",
        vary=planned.vary,
        latency_s=planned.latency_s,
        duration_s=DURATION_S,
        scored_from_s=SCORED_FROM_S,
    )


def scenarios() -> Part:
    """Return the part of the scenarios, most of which repeat."""
    names = ("straight", "circle", "triangle", "random", "close", "breathing", "rest")
    return Part("Scenarios", ("scenario",), LAWS, _by_name(names), "Wiener floor")


def targets() -> Part:
    """Return the part of targets that do what they did not do before."""
    names = ("drift", "steps", "stop_and_go", "leave_and_return", "close_random")
    title = "Targets that drift, step, rest, leave, or wander close by"
    return Part(title, ("scenario",), FEW, _by_name(names), "Wiener floor")


def disturbances() -> Part:
    """Return the part of the disturbances; those that begin during a run do so at 60 s."""
    cases = [Case(("nominal",), "straight")]
    cases += [
        Case((name,), "straight", (name,), last=overrides.read(name).summary)
        for name in overrides.names()
    ]
    return Part("Disturbances, on `straight`", ("disturbance",), FEW, tuple(cases), "what")


def latencies() -> Part:
    """Return the part of the latencies."""
    cases = [
        Case((name, f"{s:g} s"), name, latency_s=None if s == NOMINAL_S else s)
        for name in ("straight", "circle")
        for s in LATENCIES
    ]
    return Part("Latencies", ("scenario", "latency"), FEW, tuple(cases))


def plants() -> Part:
    """Return the part of the transmissions that no controller models, without inertia."""
    noise = (f"camera.truth_noise_px={NOISE_PX:g}",)
    cases = [
        Case((rig, name), name, noise, rig=rig, last=rigs.RIGS[rig].summary)
        for rig in rigs.FIXED
        if rig != "play"  # which the controllers do model
        for name in ("straight", "circle", "random")
    ]
    title = f"Plants of other kinds, with {NOISE_PX:g} px of noise"
    return Part(title, ("rig", "scenario"), (*SIMPLE, LOCK), tuple(cases), "what")


PARTS: dict[str, Callable[[], Part]] = {
    made.__name__: made for made in (scenarios, targets, disturbances, latencies, plants)
}
"""All parts of the page, by name."""


def page() -> str:
    """Run the benchmark and return docs/benchmark.md."""
    begin = time.perf_counter()
    text = run([make() for make in PARTS.values()])
    minutes = 5 * ceil((time.perf_counter() - begin) / 300)
    return HEAD.format(minutes=minutes) + text + CLOSING


def run(parts: Sequence[Part]) -> str:
    """Run parts, each run only once, and lay them out, with where the lock loses."""
    planned = list(dict.fromkeys(one for part in parts for one in part.runs()))
    results = dict(zip(planned, batch.perform(list(map(experiment, planned))), strict=True))
    return "".join(tables(part, results, experiment) for part in parts) + where(parts, results)


def where(parts: Sequence[Part], results: Results) -> str:
    """Say where the lock loses, as a part of the page."""
    rows = losses(parts, results, LOCK)
    known = ", ".join(f"`{name}`" for name in SIMPLE)
    rule = (
        f"Rows in which `{LOCK}` has an rms above {RMS_TIMES:g} times the best of {known} and "
        f"{RMS_MORE_PX:g} px, or a largest error above {MAX_TIMES:g} times the least of theirs and "
        f"{MAX_MORE_PX:g} px"
    )
    said = f"{rule}:\n\n" + "\n".join(rows) if rows else f"{rule}: none of them."
    return f"\n## Where it loses\n\n{said}\n"


def main(args: list[str]) -> int:
    """Print the page, or the parts that are named."""
    unknown = [name for name in args if name not in PARTS]
    if unknown:
        raise ConfigError(f"part '{unknown[0]}' is unknown", f"use {', '.join(PARTS)}")
    print(run([PARTS[name]() for name in args]) if args else page())
    return 0


def _by_name(names: Sequence[str]) -> tuple[Case, ...]:
    return tuple(Case((name,), name, last=_floor(name)) for name in names)


def _floor(name: str) -> str:
    floor = theory.floor_px(scenario.load(name))
    return "-" if floor is None else f"{floor:.1f}"


if __name__ == "__main__":
    sys.exit(cli.guarded(main, sys.argv[1:]))
