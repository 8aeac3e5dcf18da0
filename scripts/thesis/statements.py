"""The statements of the excerpt, each as a test on runs (see `chapter_runs`).

A statement that the excerpt does not make for a column has no expectation there. Bounds are read
off the axis limits of the excerpt's plots; where it says "around", "slightly" or "comparable", the
tolerance is assumed and part of the expectation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from endolock.control.rms import rms
from endolock.hw.api import Vector
from endolock.scripts.runs.batch import FOLLOWED
from endolock.scripts.runs.target_path import hindsight
from endolock.scripts.thesis import chapter_runs
from endolock.scripts.thesis.chapter_runs import LATENCIES_S, LATENCY_S, LAWS, STROKE_S, Trace
from endolock.scripts.thesis.measures import (
    FAST_S,
    after_switches,
    breaks,
    fast_turn,
    largest,
    peak_delay,
    peaks_by_way,
    within,
)

PEAK_PX = {"a": (180, 200), "b": (200, 250)}
GAIN_PX = (55, 75)
"""T1: bounds of the peak of PI, the lower one excluded. T2: "around 65", assumed to mean +- 10."""
VISIBLE_PX, SMALL_PX = 2.0, 25.0
"""T5: limits below which a discontinuity is invisible in the excerpt's plots, and above which it is
not small: 1 and 10 % of their height [px]. Assumed."""
PEAKS_DIFFER_PX = 10.0
"""T6, T9: peaks that differ by less count as equal [px]. Assumed: 5 % of the plots' height."""
Traces = Mapping[str, Trace]


class Verdict(NamedTuple):
    """Result of one statement in one column."""

    expected: str | None
    """In words; None where the excerpt makes no statement."""
    got: str
    ok: bool


Question = Callable[[Traces, str], Verdict]
QUESTIONS: dict[str, tuple[Question, str, Mapping[str, str]]] = {}
"""By id: the test, the columns for which the excerpt makes the statement, and its basis in each
column."""


def ask(runs: Mapping[str, Traces]) -> list[dict[str, Any]]:
    """Test all statements in both columns.

    Args:
        runs: traces by column and name.
    """
    rows = []
    for name, (question, columns, basis) in QUESTIONS.items():
        for column, traces in runs.items():
            verdict = question(traces, column)
            stated = column in columns
            rows.append(
                {
                    "id": name,
                    "column": column,
                    "statement": (question.__doc__ or "").split("\n")[0].removesuffix("."),
                    "expected": verdict.expected if stated else None,
                    "got": verdict.got,
                    "ok": bool(verdict.ok) if stated else None,
                    "basis": basis.get(column, "predicted"),
                }
            )
    return rows


def statement(
    name: str, columns: str = "ab", basis: Mapping[str, str] | None = None
) -> Callable[..., Question]:
    """Register a statement; a column without a basis is predicted."""

    def enter(question: Question) -> Question:
        QUESTIONS[name] = question, columns, basis or {}
        return question

    return enter


CALIBRATED = dict.fromkeys("ab", "calibrated")


def gain_px(runs: Traces) -> float:
    """Reduction of the largest error on `straight` by compensation [px]."""
    pi, hc = (runs[f"straight-{law}"].total.max() for law in ("pi", "pi_hc"))
    return float(pi - hc)


def needed_deg() -> float:
    """Peak-to-peak motion of a tip that always points at the target of `straight` [deg]."""
    task = chapter_runs.experiment("b", "straight", "still").resolve()
    return max(hindsight(task.scenario, task.instrument, seed=0).needed_tip_deg)


@statement("T1", basis=CALIBRATED)
def straight_pi(runs: Traces, column: str) -> Verdict:
    """Straight, PI: peak."""
    low, high = PEAK_PX[column]
    one = runs["straight-pi"]
    peak = one.total.max()
    got = f"{peak:.1f} px (held still: {runs['straight-still'].total.max():.0f}); tip {_tip(one)}"
    return Verdict(f"{low} to {high} px", got, low < peak <= high)


@statement("T2", basis=CALIBRATED)
def straight_gain(runs: Traces, column: str) -> Verdict:
    """Straight, compensation brings the target closer by."""
    low, high = GAIN_PX
    gain = gain_px(runs)
    pi, hc = (runs[f"straight-{law}"].strokes() for law in ("pi", "pi_hc"))
    out, back = peaks_by_way(pi - hc)
    got = f"{gain:.0f} px at the largest peak; ways out {out:.0f} px, ways back {back:.0f} px"
    return Verdict(f"{low} to {high} px", got, low <= gain <= high)


@statement("T3")
def straight_compensated(runs: Traces, column: str) -> Verdict:
    """Straight, PI with compensation: peak."""
    bound = 150 if column == "a" else 180
    one = runs["straight-pi_hc"]
    peak = one.total.max()
    return Verdict(f"{bound} px at most", f"{peak:.0f} px; tip {_tip(one)}", peak <= bound)


@statement("T4", basis={"b": "calibrated"})
def straight_ik(runs: Traces, column: str) -> Verdict:
    """Straight, inverse kinematics against PI with compensation."""
    pi, hc, ik = (rms(runs[f"straight-{law}"].total) for law in ("pi", "pi_hc", "ik"))
    one = runs["straight-ik"]
    peak = one.total.max()
    beside = f"PI {pi:.0f}, compensated {hc:.0f}"
    got = f"peak {peak:.0f} px, rms {ik:.0f} px ({beside}); tip {_tip(one)}"
    if column == "a":
        good = peak <= 150 and 0.75 * hc <= ik < hc
        return Verdict("150 px at most, rms up to 25 % lower than compensated", got, good)
    good = peak <= 180 and 0.75 * min(pi, hc) <= ik <= 1.25 * max(pi, hc)
    expected = "180 px at most, rms between those of PI with and without, or 25 % beyond"
    return Verdict(expected, got, good)


@statement("T5")
def discontinuities(runs: Traces, column: str) -> Verdict:
    """Straight, PI with compensation: small discontinuities near 1, 6, 10, 15 and 18 s."""
    near, elsewhere = breaks(runs["straight-pi_hc"])
    without, _ = breaks(runs["straight-pi"])
    got = (
        f"x breaks by {', '.join(f'{size:.1f}' for size in near)} px, elsewhere by "
        f"{elsewhere:.1f} px at most; without compensation by {max(without):.1f} px at most"
    )
    if column == "a":
        good = max(near) <= VISIBLE_PX
        return Verdict(f"none to be seen: {VISIBLE_PX:g} px at most", got, good)
    good = elsewhere < max(near) and all(
        max(VISIBLE_PX, b) < a <= SMALL_PX for a, b in zip(near, without, strict=True)
    )
    expected = f"at each {VISIBLE_PX:g} to {SMALL_PX:g} px, more than without, and less elsewhere"
    return Verdict(expected, got, good)


@statement("T6")
def two_peaks(runs: Traces, column: str) -> Verdict:
    """Straight, PI with compensation: peaks on the way out and on the way back."""
    out, back = peaks_by_way(runs["straight-pi_hc"].strokes())
    got = f"out {out:.0f} px, back {back:.0f} px"
    apart = abs(out - back)
    if column == "a":
        differ = apart > PEAKS_DIFFER_PX
        return Verdict(f"they differ by more than {PEAKS_DIFFER_PX:g} px", got, differ)
    return Verdict(f"they differ by {PEAKS_DIFFER_PX:g} px at most", got, apart <= PEAKS_DIFFER_PX)


@statement("T7", basis=dict.fromkeys("ab", "provoked"))
def over_compensated(runs: Traces, column: str) -> Verdict:
    """A width over-estimated further makes it unstable."""
    plain, over = runs["straight-pi_hc"], runs["over"]
    rate = sum(len(over.turns(axis)) for axis in (0, 1)) / over.t[-1]
    growth = rms(over.total) / rms(plain.total)
    got = f"at 0.3 {rate:.1f} turns of both handles a second, {growth:.1f} times the rms at 0.2"
    expected = "more than one turn a second, and 1.5 times the rms"
    return Verdict(expected, got, rate > 1 and growth > 1.5)


@statement("T8", columns="b")
def handle_and_offset(runs: Traces, column: str) -> Verdict:
    """Fig 6.5: handle 80 deg to one side, offset within 200 px, fast turns that move little."""
    one, start_s = runs["straight-pi_hc"], STROKE_S + LATENCY_S  # the first stroke may differ
    handle = one.handle[one.handle_t > start_s, 1]
    offset = largest(np.abs(one.error[one.t > start_s, 0]))
    sweep, beyond = float(np.ptp(handle)), float(max(0.0, -handle.min()))
    fast = fast_turn(one, start_s)
    good = 60 <= sweep <= 100 and beyond <= 0.1 * sweep and offset <= 200 and fast >= 20
    got = (
        f"{sweep:.0f} deg, of it {beyond:.0f} deg beyond the start; {offset:.0f} px; up to "
        f"{fast:.0f} deg within {FAST_S:g} s that hardly move the target"
    )
    expected = "80 +- 20 deg, 10 % of it beyond the start, 200 px at most, fast turns of 20 deg"
    return Verdict(expected, got, good)


@statement("T9", columns="b")
def ik_peaks(runs: Traces, column: str) -> Verdict:
    """Straight, inverse kinematics: different peaks at switches, for the distance is assumed."""
    one, known = runs["straight-ik"], runs["known"]
    late = peak_delay(one)
    apart, left = (abs(np.subtract(*peaks_by_way(trace.strokes()))) for trace in (one, known))
    good = late <= STROKE_S / 2 and apart > PEAKS_DIFFER_PX and left < apart / 2
    got = (
        f"peaks {late:.1f} s after the switch; far and near differ by {apart:.0f} px, with the "
        f"distance known by {left:.0f} px"
    )
    expected = (
        f"within {STROKE_S / 2:.1f} s; by more than {PEAKS_DIFFER_PX:g} px, less than half of it "
        "with the distance known"
    )
    return Verdict(expected, got, good)


@statement("T10", columns="b")
def circle(runs: Traces, column: str) -> Verdict:
    """Circle: all within 180 px, inverse kinematics slightly best, compensation no clear gain."""
    traces = [runs[f"circle-{law}"] for law in ("pi", "pi_hc", "ik")]
    pi, hc, ik = (rms(one.total) for one in traces)
    peak = max(one.total.max() for one in traces)
    got = f"largest peak {peak:.0f} px; rms PI {pi:.0f}, compensated {hc:.0f}, IK {ik:.0f} px"
    best = min(pi, hc)
    good = peak <= 180 and 0.75 * best <= ik < best and hc > 0.9 * pi
    expected = "180 px at most, IK lowest by up to 25 %, compensation gains less than 10 %"
    return Verdict(expected, got, good)


@statement("T11", columns="b")
def ik_is_rough(runs: Traces, column: str) -> Verdict:
    """Circle: inverse kinematics is less smooth, vibrates near 3 s, and blurs more."""
    traces = [runs[f"circle-{law}"] for law in ("ik", "pi", "pi_hc")]
    later = [
        one.t[1:-1] > LATENCY_S + 1.0 for one in traces
    ]  # without the transient of the first second
    overall = [rms(one.breaks()[part]) for one, part in zip(traces, later, strict=True)]
    near = [rms(one.breaks()[within(one.t[1:-1], 3.0)]) for one in traces]
    blur = [one.blur_px for one in traces]
    got = "; ".join(
        f"{what}: IK {ik:.2f}, PI {pi:.2f}, compensated {hc:.2f} px"
        for what, (ik, pi, hc) in (
            ("second differences", overall),
            ("near 3 s", near),
            ("blur", blur),
        )
    )
    good = all(ik > max(others) for ik, *others in (overall, near, blur)) and near[0] > overall[0]
    expected = "all three larger than of PI with and without, and near 3 s more than elsewhere"
    return Verdict(expected, got, good)


@statement("T12", columns="b")
def both_axes(runs: Traces, column: str) -> Verdict:
    """Circle: compensation works on both axes; switched off early, an extra peak in x at 13 s."""
    pi, hc = runs["circle-pi"], runs["circle-pi_hc"]
    works = all(rms(hc.error[:, axis]) < rms(pi.error[:, axis]) for axis in (0, 1))
    near = within(hc.t, 13.0)
    other = np.interp(hc.t[near], pi.t, np.abs(pi.error[:, 0]))
    extra = largest(np.abs(hc.error[near, 0]) - other)
    off = bool((hc.compensation[within(hc.handle_t, 13.0), 1] == 0).any())
    got = (
        f"rms x {rms(hc.error[:, 0]):.0f} for {rms(pi.error[:, 0]):.0f}, y "
        f"{rms(hc.error[:, 1]):.0f} for {rms(pi.error[:, 1]):.0f} px; near 13 s x is at "
        f"most {extra:.0f} px larger than under PI, compensation {'is' if off else 'is never'} "
        "switched off there"
    )
    good = works and extra >= 20 and off
    return Verdict("smaller on both axes; 20 px more near 13 s, switched off there", got, good)


@statement("T13")
def large_at_turns(runs: Traces, column: str) -> Verdict:
    """Straight, PI, the tip following: a large error after each switch, because of hysteresis."""
    hysteretic, free = runs["straight-pi"], runs["free"]
    error, error_free = after_switches(hysteretic), after_switches(free)
    least = float(np.min(error / error_free))
    follows = hysteretic.tip_deg(2 * STROKE_S) >= FOLLOWED[0] * needed_deg()
    got = (
        f"within 1.5 s after the switches {_row(error)} px, without hysteresis "
        f"{_row(error_free)} px: {least:.1f} times or more; tip {_tip(hysteretic)} and {_tip(free)}"
    )
    expected = "1.5 times that without hysteresis, or more, at each; the tip follows"
    return Verdict(expected, got, follows and least >= 1.5)


@statement("T14", columns="b")
def latency_limits(runs: Traces, column: str) -> Verdict:
    """Straight: the latency of 0.4 s limits the performance."""
    names = [f"-{latency:g}s" for latency in LATENCIES_S] + [""]
    found = {law: [rms(runs[f"straight-{law}{n}"].total) for n in names] for law in LAWS[1:]}
    got = "; ".join(f"{law} {', '.join(f'{v:.0f}' for v in of)} px" for law, of in found.items())
    good = all(a < b < c and c >= 1.1 * a for a, b, c in found.values())
    expected = "rms at 0, 0.2, 0.4 s rises with every controller, from 0 to 0.4 s by 10 % or more"
    return Verdict(expected, got, good)


def _tip(one: Trace) -> str:
    return f"{one.tip_deg(2 * STROKE_S):.0f} deg"


def _row(values: Vector) -> str:
    return ", ".join(f"{value:.0f}" for value in values)
