"""Open questions of the thesis about close targets, run on the twin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from endolock.control.transmission.kinematics import SectionGeometry
from endolock.control.transmission.linear_process import HOLD_S, Process, image_gain, simc
from endolock.scripts.figures.palette import SERIES
from endolock.scripts.runs import batch
from endolock.scripts.runs.batch import FinishedRun
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.markdown_table import markdown_table
from endolock.scripts.studies.answers import NO_FRICTION, Answer, experiment

DISTANCES_M = (0.015, 0.03, 0.06, 0.12)


def relative() -> Answer:
    """Is the relative effect of hysteresis larger at 1 to 2 cm?"""
    laws = ("pi_simc", "ik_sync")
    cases = [(d, law) for d in DISTANCES_M for law in laws]
    with_ = batch.all_of([near(d, law, *tuned(law, d)) for d, law in cases])
    free = batch.all_of([near(d, law, *tuned(law, d), *NO_FRICTION) for d, law in cases])
    ratio = {
        case: a.rms / b.rms if a.follows else np.nan
        for case, a, b in zip(cases, with_, free, strict=True)
    }
    travel = [float(np.degrees(np.ptp(one.handle[one.t > 10, 1]))) for one in free[:: len(laws)]]
    rows = [
        [
            f"{1e3 * d:.0f} mm",
            f"{1e3 * _travel(d):.0f} mm",
            f"{travel[n]:.0f} deg",
            *("parked" if np.isnan(ratio[d, law]) else f"{ratio[d, law]:.1f}" for law in laws),
            _tips(with_[n * len(laws) :][: len(laws)]),
        ]
        for n, d in enumerate(DISTANCES_M)
    ]
    head = ["distance", "stroke", "handle travel without friction"]
    head += [f"{law}: error over that without friction" for law in laws]
    text = markdown_table([*head, f"tip: needed, {', '.join(laws)}"], rows)

    def draw(panel: Any) -> None:
        for n, law in enumerate(laws):
            mm = [1e3 * d for d in DISTANCES_M]
            panel.plot(mm, [ratio[d, law] for d in DISTANCES_M], "o-", color=SERIES[n], label=law)
        panel.set_xlabel("distance [mm]")
        panel.set_ylabel("error over that without friction [1]")
        panel.set_ylim(bottom=0)

    return Answer(text, draw)


def integral() -> Answer:
    """Does a close target require weaker integral action?"""
    shares = (0.15, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5)
    distances = (DISTANCES_M[0], DISTANCES_M[-1])
    best = {d: simc(_process(d)) for d in distances}
    experiments = [
        near(d, "pi", "law.kp=0", f"law.ki={share * best[distances[1]][1]:.5g}")
        for d in distances
        for share in shares
    ]
    done = batch.all_of(experiments)
    gains = [share * best[distances[1]][1] for share in shares]
    runs = {d: done[n * len(shares) :][: len(shares)] for n, d in enumerate(distances)}
    rms = {d: [one.rms for one in runs[d]] for d in distances}
    rows = []
    for d in distances:
        following = [n for n, one in enumerate(runs[d]) if one.follows]
        cells = ["none", "", ""]
        if following:
            least = min(following, key=rms[d].__getitem__)
            cells = [f"{gains[least]:.2f}", f"{rms[d][least]:.0f} px", _tips([runs[d][least]])]
        rows.append(
            [
                f"{1e3 * d:.0f} mm",
                f"{_process(d).gain:.2f}",
                f"{best[d][1]:.2f}",
                f"{np.pi / 2 / _process(d).dead_s / _process(d).gain:.2f}",
                *cells,
                f"{gains[int(np.argmin(rms[d]))]:.2f}, {min(rms[d]):.0f} px",
            ]
        )
    head = ["distance", "error per handle", "SIMC ki", "largest stable ki"]
    head += ["best ki that follows", "its rms", "tip: needed, got", "best ki of all, its rms"]

    def draw(panel: Any) -> None:
        for n, d in enumerate(distances):
            panel.semilogy(gains, rms[d], "o-", color=SERIES[n], label=f"{1e3 * d:.0f} mm")
            limit = np.pi / 2 / _process(d).dead_s / _process(d).gain
            panel.axvline(limit, color=SERIES[n], ls=":", lw=1)
        panel.set_xlabel("ki [1/s]; dotted: the linear limit")
        panel.set_ylabel("rms error [px]")

    return Answer(markdown_table(head, rows), draw)


def aiming() -> Answer:
    """Is inverse kinematics better close to the target?"""
    laws = {
        "PI, tuned at 12 cm": ("pi_simc", 0.12),
        "PI, tuned here": ("pi_simc", None),
        "IK, 12 cm assumed": ("ik", 0.12),
        "IK, distance known": ("ik", None),
        "IK with time stamps": ("ik_sync", None),
    }
    cases = [(d, name) for d in DISTANCES_M for name in laws]
    experiments = [
        near(d, law, f"law.target_distance_m={known or d:g}")
        for d in DISTANCES_M
        for law, known in laws.values()
    ]
    done = dict(zip(cases, batch.all_of(experiments), strict=True))

    def cell(d: float, name: str) -> str:
        one = done[d, name]
        lost = ", lost" if one.lost > 0.01 else ""
        return f"{one.rms:.0f} px, {one.tip_deg:.0f} deg{lost}"

    rows = [[name, *(cell(d, name) for d in DISTANCES_M)] for name in laws]
    first = [done[d, next(iter(laws))] for d in DISTANCES_M]
    bounds = [f"{one.constant_px:.0f} px, {one.needed_deg:.0f} deg" for one in first]
    rows.append(["best constant handle; the path needs", *bounds])

    def draw(panel: Any) -> None:
        mm = [1e3 * d for d in DISTANCES_M]
        for n, name in enumerate(laws):
            rms = [done[d, name].rms for d in DISTANCES_M]
            panel.semilogy(mm, rms, "o-", color=SERIES[n], label=name)
        panel.set_xlabel("distance [mm]")
        panel.set_ylabel("rms error [px]")

    head = ["law: rms, tip peak to peak", *(f"{1e3 * d:.0f} mm" for d in DISTANCES_M)]
    return Answer(markdown_table(head, rows), draw)


def near(distance_m: float, law: str, *changes: str) -> Experiment:
    """Describe strokes of constant image size: 40 mm at 12 cm."""
    motion = f"{{kind='strokes', travel_m={_travel(distance_m):.5g}, period_s=8.6}}"
    return experiment(
        "straight", law, f"board.distance_m={distance_m:g}", f"motion=[{motion}]", *changes
    )


def tuned(law: str, distance_m: float) -> tuple[str, ...]:
    """Return the changes that tune a controller for a distance."""
    return (f"law.target_distance_m={distance_m:g}",)


def _tips(runs: Sequence[FinishedRun]) -> str:
    """Peak-to-peak motion of the tip, needed and in runs on the same path."""
    angles = (runs[0].needed_deg, *(one.tip_deg for one in runs))
    return ", ".join(f"{angle:.1f}" for angle in angles) + " deg"


def _travel(distance_m: float) -> float:
    return 0.04 * distance_m / 0.12


def _process(distance_m: float) -> Process:
    return Process(gain=image_gain(SectionGeometry(), distance_m), dead_s=0.4 + HOLD_S)
