"""Open questions of the thesis about roughness, circles, latency and pushes, run on the twin."""

from __future__ import annotations

from typing import Any

import numpy as np

from endolock.scripts.figures.palette import SERIES
from endolock.scripts.runs import batch
from endolock.scripts.runs.batch import FinishedRun
from endolock.scripts.runs.markdown_table import markdown_table
from endolock.scripts.studies.answers import NO_FRICTION, Answer, experiment

WIDTHS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3)


def roughness() -> Answer:
    """Is the delay between handle and picture the cause of the roughness of inverse kinematics?"""
    cases = {
        "ik, frames 0.4 s old": ("ik", 0.4, ()),
        "ik, faster (3.0/s)": ("ik", 0.4, ("law.rate_per_s=3.0",)),
        "ik, faster, frames not late": ("ik", 0.0, ("law.rate_per_s=3.0",)),
        "ik_sync, frames 0.4 s old": ("ik_sync", 0.4, ()),
        "ik_sync, stamps 0.1 s wrong": ("ik_sync", 0.4, ("camera.nominal_latency_s=0.3",)),
        "ik_sync, stamps 0.2 s wrong": ("ik_sync", 0.4, ("camera.nominal_latency_s=0.2",)),
    }
    experiments = [
        experiment("circle", law, f"camera.latency_s={latency:g}", *more)
        for law, latency, more in cases.values()
    ]
    done = dict(zip(cases, batch.all_of(experiments), strict=True))
    rows = [
        [
            name,
            f"{one.rms:.0f} px",
            f"{one.record.handle.accel_rms:.2f}",
            f"{one.record.handle.reversals_per_s:.2f}",
            f"{one.tip_deg:.0f} deg",
        ]
        for name, one in done.items()
    ]

    def draw(panel: Any) -> None:
        for n, name in enumerate(list(cases)[1:]):
            one = done[name]
            late = one.t > 20
            panel.plot(one.t[late], one.distance[late], color=SERIES[n], lw=1, label=name)
        panel.set_xlabel("time [s]")
        panel.set_ylabel("error [px]")
        panel.set_ylim(bottom=0)

    head = ["law", "rms", "handle acceleration rms [rad/s2]", "handle reversals a second"]
    tip = f"tip p-p; needed {next(iter(done.values())).needed_deg:.0f} deg"
    return Answer(markdown_table([*head, tip], rows), draw)


def circles() -> Answer:
    """Does compensation help on circles, and if not, why?"""
    forms = ("sign", "smooth")
    cases = [(s, form, w) for s in ("straight", "circle") for form in forms for w in WIDTHS]
    experiments = [
        experiment(scenario, "pi_hc", f"law.form={form}", f"law.width={width}")
        for scenario, form, width in cases
    ]
    done = dict(zip(cases, batch.all_of(experiments), strict=True))
    rows = []
    for scenario in ("straight", "circle"):
        for form in forms:
            cells = []
            for width in WIDTHS:
                one = done[scenario, form, width]
                turns = one.record.handle.reversals_per_s or 0.0
                cells.append(_rms_and_tip(one) + (" *" if turns > 1.0 else ""))
            rows.append([scenario, form, *cells, f"{one.needed_deg:.0f} deg"])

    def draw(panel: Any) -> None:
        for n, scenario in enumerate(("straight", "circle")):
            for form, style in zip(forms, ("o-", "s--"), strict=True):
                rms = [done[scenario, form, width].rms for width in WIDTHS]
                label = f"{scenario}, {form}"
                panel.plot(WIDTHS, rms, style, color=SERIES[n], label=label)
        panel.set_xlabel("compensated width over 180 deg [1]")
        panel.set_ylabel("rms error [px]")
        panel.set_ylim(bottom=0)

    head = ["scenario", "form", *(f"w = {w:g}" for w in WIDTHS), "tip needed"]
    return Answer(markdown_table(head, rows), draw)


def latency() -> Answer:
    """How much error is due to latency alone?"""
    latencies = (0.0, 0.1, 0.2, 0.4, 0.8)
    laws = ("pi_simc", "ik_sync")
    plants: dict[str, tuple[str, ...]] = {"as it is": (), "without friction": NO_FRICTION}
    cases = [(law, plant, s) for law in laws for plant in plants for s in latencies]
    experiments = [
        experiment("straight", law, f"camera.latency_s={s:g}", *plants[plant])
        for law, plant, s in cases
    ]
    done = dict(zip(cases, batch.all_of(experiments), strict=True))
    rows = [
        [law, plant, *(_rms_and_tip(done[law, plant, s]) for s in latencies)]
        for law in laws
        for plant in plants
    ]

    def draw(panel: Any) -> None:
        for n, law in enumerate(laws):
            for plant, style in zip(plants, ("o-", "s--"), strict=True):
                rms = [done[law, plant, s].rms for s in latencies]
                panel.plot(latencies, rms, style, color=SERIES[n], label=f"{law}, {plant}")
        panel.set_xlabel("latency [s]")
        panel.set_ylabel("rms error [px]")
        panel.set_ylim(bottom=0)

    return Answer(markdown_table(["law", "plant", *(f"{s:g} s" for s in latencies)], rows), draw)


def _rms_and_tip(one: FinishedRun) -> str:
    return f"{one.rms:.0f} px, {one.tip_deg:.0f} deg"


def after_a_push() -> Answer:
    """How likely and how large is a jump after a push, and does a known tip pose help?"""
    laws: dict[str, tuple[str, tuple[str, ...]]] = {
        "PI": ("pi", ()),
        "PI + compensation (sign)": ("pi_hc", ()),
        "tuned PI + compensation (smooth)": ("pi_simc_hc", ()),
        "hysteresis model, tip unknown": ("oracle", ("law.correct_s=1e6",)),
        "hysteresis model, tip pose fed": ("oracle", ()),
    }
    forces, phases = (0.3, 0.6, 1.2), (0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875)

    def pushed(law: str, more: tuple[str, ...], force: float, phase: float) -> Any:
        start = 17.2 + phase * 8.6
        push = f"{{start_s={start:g}, over_s=0.5, force_n={force}, direction_deg=0.0}}"
        return experiment("straight", law, f"push=[{push}]", *more)

    cases = [(name, force, phase) for name in laws for force in forces for phase in phases]
    experiments = [pushed(*laws[name], force, phase) for name, force, phase in cases]
    experiments += [experiment("straight", *(law, *more)) for law, more in laws.values()]
    done = batch.all_of(experiments)
    calm = dict(zip(laws, done[len(cases) :], strict=True))
    jumps: dict[tuple[str, float], list[float]] = {}
    for (name, force, phase), one in zip(cases, done, strict=False):
        start = 17.2 + phase * 8.6
        # After the force has ended: the reaction of the controller, not the push itself.
        after = (one.t > start + 0.6) & (one.t < start + 4.0)
        jump = float(np.hypot(*(one.error - calm[name].error)[after].T).max())
        jumps.setdefault((name, force), []).append(jump)
    rows = [
        [
            name,
            f"{calm[name].tip_deg:.0f} deg",
            *(
                f"{100 * np.mean(np.array(jumps[name, force]) > 30):.0f} %, "
                f"{max(jumps[name, force]):.0f} px"
                for force in forces
            ),
        ]
        for name in laws
    ]

    def draw(panel: Any) -> None:
        for n, name in enumerate(laws):
            values = jumps[name, forces[-1]]
            panel.plot(phases, values, "o-", color=SERIES[n], label=name)
        panel.set_xlabel(f"phase of the stroke at which {forces[-1]} N push")
        panel.set_ylabel("largest deviation afterwards [px]")
        panel.set_ylim(bottom=0)

    head = ["law", "tip p-p, undisturbed", *(f"{force} N: over 30 px, largest" for force in forces)]
    return Answer(markdown_table(head, rows), draw)
