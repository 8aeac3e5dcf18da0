"""The benchmark of laws: scenarios, disturbances and latencies, as docs/benchmark.md shows them.

Runs take 100 s and are scored from 50 s, at f = 262 px, without pictures (a test holds that these
give the same), one seed. The full product is `endolock compare --vary ... --latencies ...`.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from math import ceil

from endolock.scripts import batch, output, run, theory, variation
from endolock.scripts.batch import Done
from endolock.twin import scenario

SCENARIOS = ("straight", "circle", "triangle", "random", "close", "breathing", "rest")
LAWS = (
    *("pi", "pi_hc", "ik", "pi_simc", "pi_simc_hc", "ik_sync", "smith", "repetitive"),
    *("predictive", "predictive_bank", "oracle"),
)
FEW = ("pi", "pi_hc", "pi_simc", "pi_simc_hc", "predictive_bank", "oracle")
"""Laws of the larger tables: five and the floor."""
LATENCIES = (0.06, 0.2, 0.4, 0.8)
DURATION_S, SCORED_FROM_S = 100.0, 50.0
HEAD = """# Benchmark of laws

Written by `./run docs`, within {minutes} minutes on two cores. Rms of the true error in px, at
f = 262 px, 0.4 s of latency unless stated, 100 s of which the last 50 are scored, seed 0, exact
projections instead of pictures, on a simulated plant: none of this was measured on an endoscope.
`oracle` knows the truth and has no latency: it is a floor, no law. *lost* stands where the target
was out of sight for more than 1 % of the time.
"""


def request(
    name: str, law: str, vary: Iterable[str] = (), latency_s: float | None = None
) -> run.Request:
    """Ask for one run of the benchmark."""
    return run.Request(
        scenario=name,
        controller=law,
        vision="truth",
        vary=tuple(vary),
        latency_s=latency_s,
        duration_s=DURATION_S,
        scored_from_s=SCORED_FROM_S,
    )


def page() -> str:
    """Measure and lay out docs/benchmark.md."""
    begin = time.perf_counter()
    nominal = [(name, law) for name in SCENARIOS for law in LAWS]
    varied = [(name, law) for name in variation.names() for law in FEW]
    late = [(n, s, law) for n in ("straight", "circle") for s in LATENCIES for law in FEW]
    asked = [request(*pair) for pair in nominal]
    asked += [request("straight", law, (name,)) for name, law in varied]
    asked += [request(n, law, (), s) for n, s, law in late]
    cells = [_cell(record) for record in batch.perform(asked)]
    first, rest = cells[: len(nominal)], cells[len(nominal) :]
    second, third = rest[: len(varied)], rest[len(varied) :]

    rows = [
        [name, *first[n * len(LAWS) : (n + 1) * len(LAWS)], _floor(name)]
        for n, name in enumerate(SCENARIOS)
    ]
    text = f"\n## Scenarios\n\n{output.markdown(['scenario', *LAWS, 'Wiener floor'], rows)}"
    straight = SCENARIOS.index("straight") * len(LAWS)
    rows = [["nominal", *(first[straight + LAWS.index(law)] for law in FEW), ""]]
    rows += [
        [name, *second[n * len(FEW) : (n + 1) * len(FEW)], variation.read(name).summary]
        for n, name in enumerate(variation.names())
    ]
    text += "\n## Disturbances, on `straight`\n\n"
    text += output.markdown(["disturbance", *FEW, "what"], rows)
    rows = [
        [name, f"{s:g} s", *third[n * len(FEW) : (n + 1) * len(FEW)]]
        for n, (name, s) in enumerate((n, s) for n in ("straight", "circle") for s in LATENCIES)
    ]
    text += f"\n## Latencies\n\n{output.markdown(['scenario', 'latency', *FEW], rows)}"
    minutes = 5 * ceil((time.perf_counter() - begin) / 300)
    return HEAD.format(minutes=minutes) + text + CLOSING


CLOSING = """
The Wiener floor is what no prediction of that random motion can beat at the latency, servo lag and
0.03 s of hold, with 0.1 px of noise; where the motion is not random there is no such floor. Sizes
of disturbances: [models/disturbances](../models/disturbances). One row again, margins and figure:

    ./run endolock compare --scenarios straight --controllers pi pi_simc --vary width_more \\
        --vision truth --duration-s 100 --scored-from-s 50
"""


def _cell(done: Done | None) -> str:
    if done is None:
        return "-"
    lost = done.record["lost_fraction"]
    return f"{done.rms:.1f}" + (f" (lost {100 * lost:.0f} %)" if lost > 0.01 else "")


def _floor(name: str) -> str:
    floor = theory.floor_px(scenario.load(name))
    return "-" if floor is None else f"{floor:.1f}"


if __name__ == "__main__":
    print(page())
