"""The benchmark of the controllers: scenarios, disturbances and latencies, for docs/benchmark.md.

Runs take 100 s and are scored from 50 s, at f = 262 px, without pictures (a test shows that runs
with pictures give the same result), with one seed. For other combinations use
`endolock compare --vary ... --latencies ...`.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from itertools import pairwise
from math import ceil

from endolock.scripts.runs import batch, overrides, theory
from endolock.scripts.runs.batch import FinishedRun
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.markdown_table import markdown_table
from endolock.twin.world import scenario

SCENARIOS = ("straight", "circle", "triangle", "random", "close", "breathing", "rest")
LAWS = (
    *("still", "pi", "pi_hc", "ik", "pi_simc", "pi_simc_hc", "ik_sync", "smith", "repetitive"),
    *("predictive", "predictive_bank", "oracle"),
)
FEW = ("still", "pi", "pi_hc", "ik_sync", "predictive_bank")
"""Controllers of the larger tables: holding still, and four that move."""
LATENCIES = (0.06, 0.2, 0.4, 0.8)
DURATION_S, SCORED_FROM_S = 100.0, 50.0
HEAD = """# Benchmark of the controllers

Written by `./run docs`, within {minutes} minutes on two cores. Rms of the true error in px, at
f = 262 px and 0.4 s of latency unless stated, 100 s of which the last 50 are scored, seed 0, exact
projections instead of pictures, on a simulated plant: none of this was measured on an endoscope.
`still` holds the handles at their initial angles, and *constant* is the best result of a constant
handle angle, known in hindsight: a controller that is not better has gained nothing by moving the
handles. `oracle` knows the truth and has no latency: it is a lower bound, not a controller. *lost*:
the target was out of sight for more than 1 % of the time; *unstable*: the linear loop is unstable,
as with the gains of `pi`, which are valid for 12 cm and 0.4 s.

Each table of errors is followed by its cost: peak-to-peak motion of tip and handle, on the axis
that moves more. Where the tip moves much less than the path needs, the controller is parked, and
its error is that of a constant handle angle.
"""


def experiment(
    name: str, law: str, vary: Iterable[str] = (), latency_s: float | None = None
) -> Experiment:
    """Describe one run of the benchmark."""
    return Experiment(
        scenario=name,
        controller=law,
        vision="truth",
        vary=tuple(vary),
        latency_s=latency_s,
        duration_s=DURATION_S,
        scored_from_s=SCORED_FROM_S,
    )


def page() -> str:
    """Run the benchmark and return docs/benchmark.md."""
    begin = time.perf_counter()
    nominal = [(name, law) for name in SCENARIOS for law in LAWS]
    varied = [(name, law) for name in overrides.names() for law in FEW]
    late = [(n, s, law) for n in ("straight", "circle") for s in LATENCIES for law in FEW]
    experiments = [experiment(*pair) for pair in nominal]
    experiments += [experiment("straight", law, (name,)) for name, law in varied]
    experiments += [experiment(n, law, (), s) for n, s, law in late]
    done = batch.perform(experiments)
    sizes = (len(nominal), len(varied), len(late))
    ends = [sum(sizes[:n]) for n in range(len(sizes) + 1)]
    first, second, third = ((experiments[a:b], done[a:b]) for a, b in pairwise(ends))
    text = _tables(
        "Scenarios",
        ["scenario"],
        LAWS,
        [[name] for name in SCENARIOS],
        *first,
        ("Wiener floor", [_floor(name) for name in SCENARIOS]),
    )
    straight = SCENARIOS.index("straight") * len(LAWS)
    plain = [straight + LAWS.index(law) for law in FEW]
    names = overrides.names()
    text += _tables(
        "Disturbances, on `straight`",
        ["disturbance"],
        FEW,
        [[name] for name in ("nominal", *names)],
        [first[0][n] for n in plain] + second[0],
        [first[1][n] for n in plain] + second[1],
        ("what", ["", *(overrides.read(name).summary for name in names)]),
    )
    cases = [(n, s) for n in ("straight", "circle") for s in LATENCIES]
    text += _tables(
        "Latencies",
        ["scenario", "latency"],
        FEW,
        [[name, f"{s:g} s"] for name, s in cases],
        *third,
    )
    minutes = 5 * ceil((time.perf_counter() - begin) / 300)
    return HEAD.format(minutes=minutes) + text + CLOSING


def _tables(
    title: str,
    heads: list[str],
    laws: Sequence[str],
    cases: Sequence[list[str]],
    experiments: Sequence[Experiment],
    done: Sequence[FinishedRun | None],
    last: tuple[str, list[str]] | None = None,
) -> str:
    """Format one part: the errors, and below them the motion of tip and handle.

    Args:
        title: heading of the part.
        heads: headings of the first columns.
        laws: names of the controllers, in the order of the runs.
        cases: first cells of each row.
        experiments: the experiments, case by case.
        done: the results, in the same order; None where the run is undefined.
        last: heading and cells of a further column of the table of errors.
    """
    errors, prices = [], []
    for n, first in enumerate(cases):
        part = slice(n * len(laws), (n + 1) * len(laws))
        tasks, own = experiments[part], done[part]
        more = [last[1][n]] if last else []
        known = next(one for one in own if one)
        errors.append([*first, *map(_error, tasks, own), f"{known.constant_px:.1f}", *more])
        prices.append([*first, *map(_price, own), f"{known.needed_deg:.0f}"])
    head = [*heads, *laws, "constant", *([last[0]] if last else [])]
    price_head = [*heads, *laws, "tip needed"]
    return (
        f"\n## {title}\n\n{markdown_table(head, errors)}"
        f"\nTip / handle, peak to peak in deg:\n\n{markdown_table(price_head, prices)}"
    )


CLOSING = """
The Wiener floor is a lower bound for every prediction of that random motion, with the latency,
servo lag, 0.03 s of hold, and 0.1 px of noise; other motions have no such bound. Sizes of the
disturbances: [models/disturbances](../models/disturbances). To repeat one row, with margins and a
figure:

    ./run endolock compare --scenarios straight --controllers pi pi_simc --vary width_more \\
        --vision truth --duration-s 100 --scored-from-s 50
"""


def _error(experiment: Experiment, done: FinishedRun | None) -> str:
    if done is None:
        return "-"
    lost, marks = done.lost, []
    if lost > 0.01:
        marks.append(f"lost {100 * lost:.0f} %")
    if (margins := _margins(experiment)) and margins["gain"] < 1:
        marks.append("unstable")
    return f"{done.rms:.1f}" + (f" ({', '.join(marks)})" if marks else "")


def _margins(experiment: Experiment) -> dict[str, float] | None:
    task = experiment.resolve()
    margins: dict[str, float] | None = theory.of(task.scenario, task.settings)["margins"]
    return margins


def _price(done: FinishedRun | None) -> str:
    return "-" if done is None else f"{done.tip_deg:.0f} / {done.handle_deg:.0f}"


def _floor(name: str) -> str:
    floor = theory.floor_px(scenario.load(name))
    return "-" if floor is None else f"{floor:.1f}"


if __name__ == "__main__":
    print(page())
