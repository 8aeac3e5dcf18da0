"""The statements of the excerpt, each as a question to runs (see `thesis`).

What is not stated for a column has no expectation. Bounds are read off the axis limits of the
excerpt's plots; where it says "around", "slightly" or "comparable", the tolerance is assumed and
stands in the expectation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from endolock.hw.api import Vector
from endolock.scripts import run, thesis
from endolock.scripts.batch import FOLLOWED
from endolock.scripts.target_path import hindsight
from endolock.scripts.thesis import LATENCIES_S, LATENCY_S, LAWS, STROKE_S, Trace

PEAK_PX = {"a": (180, 200), "b": (200, 250)}
GAIN_PX = (55, 75)
"""T1: bounds of the peak of PI, the lower one left out. T2: "around 65", assumed to mean +- 10."""
VISIBLE_PX = 2.0
"""Smaller breaks of a course cannot be seen in the excerpt's plots: 1 % of their height [px]."""
DISCONTINUITIES_S = (1, 6, 10, 15, 18)
NEAR_S = 1.0
"""T5: where, and how near ours may be: they are told in whole seconds, and our half period of 4.3 s
is derived from them with +- 0.5 s."""
PEAKS_DIFFER_PX = 10.0
"""T6, T9: peaks that differ by less are alike. Assumed: 5 % of the plots' height."""
Traces = Mapping[str, Trace]


class Answer(NamedTuple):
    """What one statement comes to in one column."""

    expected: str | None
    """In words; None where the excerpt does not say."""
    got: str
    ok: bool


Question = Callable[[Traces, str], Answer]
QUESTIONS: dict[str, tuple[Question, str, Mapping[str, str]]] = {}
"""Each with the columns that the excerpt speaks of, and its basis in each column."""


def ask(runs: Mapping[str, Traces]) -> list[dict[str, Any]]:
    """Answer all statements in both columns.

    Args:
        runs: traces by column and name.
    """
    rows = []
    for name, (question, columns, basis) in QUESTIONS.items():
        for column, traces in runs.items():
            answer = question(traces, column)
            stated = column in columns
            rows.append(
                {
                    "id": name,
                    "column": column,
                    "statement": (question.__doc__ or "").split("\n")[0].removesuffix("."),
                    "expected": answer.expected if stated else None,
                    "got": answer.got,
                    "ok": bool(answer.ok) if stated else None,
                    "basis": basis.get(column, "predicted"),
                }
            )
    return rows


def statement(
    name: str, columns: str = "ab", basis: Mapping[str, str] | None = None
) -> Callable[..., Question]:
    """Enter a question; a column without a basis is predicted."""

    def enter(question: Question) -> Question:
        QUESTIONS[name] = question, columns, basis or {}
        return question

    return enter


CALIBRATED = dict.fromkeys("ab", "calibrated")


def gain_px(runs: Traces) -> float:
    """How much closer compensation brings the target, mean over the peaks of the strokes [px]."""
    return float(np.mean(runs["straight-pi"].strokes() - runs["straight-pi_hc"].strokes()))


def needed_deg() -> float:
    """Motion of a tip that always points at the target of `straight`, from peak to peak [deg]."""
    task = run.resolve(thesis.request("b", "straight", "still"))
    return max(hindsight(task.scenario, task.instrument, seed=0).needed_tip_deg)


@statement("T1", basis=CALIBRATED)
def straight_pi(runs: Traces, column: str) -> Answer:
    """Straight, PI: peak."""
    low, high = PEAK_PX[column]
    one = runs["straight-pi"]
    peak = one.total.max()
    got = f"{peak:.0f} px (held still: {runs['straight-still'].total.max():.0f}); tip {_tip(one)}"
    return Answer(f"{low} to {high} px", got, low < peak <= high)


@statement("T2", basis=CALIBRATED)
def straight_gain(runs: Traces, column: str) -> Answer:
    """Straight, compensation brings the target closer by."""
    low, high = GAIN_PX
    pi, hc = (runs[f"straight-{law}"] for law in ("pi", "pi_hc"))
    gain = gain_px(runs)
    got = f"{gain:.0f} px, mean of stroke peaks; in rms {_rms(pi.total) - _rms(hc.total):.0f} px"
    return Answer(f"{low} to {high} px", got, low <= gain <= high)


@statement("T3")
def straight_compensated(runs: Traces, column: str) -> Answer:
    """Straight, PI with compensation: peak."""
    bound = 150 if column == "a" else 180
    one = runs["straight-pi_hc"]
    peak = one.total.max()
    return Answer(f"{bound} px at most", f"{peak:.0f} px; tip {_tip(one)}", peak <= bound)


@statement("T4", basis={"b": "calibrated"})
def straight_ik(runs: Traces, column: str) -> Answer:
    """Straight, inverse kinematics against PI with compensation."""
    pi, hc, ik = (_rms(runs[f"straight-{law}"].total) for law in ("pi", "pi_hc", "ik"))
    one = runs["straight-ik"]
    peak = one.total.max()
    got = (
        f"peak {peak:.0f} px, rms {ik:.0f} px (PI {pi:.0f}, compensated {hc:.0f}); tip {_tip(one)}"
    )
    if column == "a":
        good = peak <= 150 and 0.75 * hc <= ik < hc
        return Answer("150 px at most, rms up to 25 % lower than compensated", got, good)
    good = peak <= 180 and 0.75 * min(pi, hc) <= ik <= 1.25 * max(pi, hc)
    return Answer("180 px at most, rms within 25 % of PI with and without", got, good)


@statement("T5")
def discontinuities(runs: Traces, column: str) -> Answer:
    """Small discontinuities near 1, 6, 10, 15 and 18 s, for the width is slightly too large."""
    with_, without = (_breaks(runs[f"straight-{law}"]) for law in ("pi_hc", "pi"))
    course = ", ".join(f"{size:.1f}" for size in with_)
    got = f"x breaks by {course} px, without compensation by {max(without):.1f} px at most"
    if column == "a":
        good = max(with_) <= VISIBLE_PX
        return Answer(f"none to be seen: {VISIBLE_PX:g} px at most", got, good)
    good = all(a > max(VISIBLE_PX, b) for a, b in zip(with_, without, strict=True))
    return Answer(f"at each more than {VISIBLE_PX:g} px, and than without", got, good)


@statement("T6")
def two_peaks(runs: Traces, column: str) -> Answer:
    """Straight, PI with compensation: two different peaks, for the way back has another width."""
    out, back = _peaks_by_way(runs["straight-pi_hc"])
    got = f"peaks on the way out {out:.0f} px, on the way back {back:.0f} px"
    apart = abs(out - back)
    if column == "a":
        differ = apart > PEAKS_DIFFER_PX
        return Answer(f"they differ by more than {PEAKS_DIFFER_PX:g} px", got, differ)
    return Answer(f"they differ by {PEAKS_DIFFER_PX:g} px at most", got, apart <= PEAKS_DIFFER_PX)


@statement("T7", basis=dict.fromkeys("ab", "provoked"))
def over_compensated(runs: Traces, column: str) -> Answer:
    """A width over-estimated further makes it unstable."""
    plain, over = runs["straight-pi_hc"], runs["over"]
    rate = sum(len(over.turns(axis)) for axis in (0, 1)) / over.t[-1]
    growth = _rms(over.total) / _rms(plain.total)
    got = f"at 0.3 {rate:.1f} turns of both handles a second, {growth:.1f} times the rms at 0.2"
    expected = "more than one turn a second, and 1.5 times the rms"
    return Answer(expected, got, rate > 1 and growth > 1.5)


@statement("T8", columns="b")
def handle_and_offset(runs: Traces, column: str) -> Answer:
    """Fig 6.5: handle 80 deg to one side, offset within 200 px, fast turns that move little."""
    one = runs["straight-pi_hc"]
    after = one.handle_t > STROKE_S + LATENCY_S  # the start may differ
    handle, offset = one.handle[after, 1], np.abs(one.error[one.t > STROKE_S + LATENCY_S, 0]).max()
    sweep, beyond = float(np.ptp(handle)), float(max(0.0, -handle.min()))
    turns = [turn for turn in one.turns(1) if turn[0] > STROKE_S + LATENCY_S]
    quiet = [size for a, b, size in turns if b - a < 0.6 and _moved(one, a, b) < 30]
    largest = max(quiet, default=0.0)
    good = 60 <= sweep <= 100 and beyond <= 0.1 * sweep and offset <= 200 and largest >= 20
    got = (
        f"{sweep:.0f} deg, of it {beyond:.0f} deg beyond the start; {offset:.0f} px; fast turns of "
        f"up to {largest:.0f} deg"
    )
    expected = "80 +- 20 deg, 10 % of it beyond the start, 200 px at most, fast turns of 20 deg"
    return Answer(expected, got, good)


@statement("T9", columns="b")
def ik_peaks(runs: Traces, column: str) -> Answer:
    """Straight, inverse kinematics: different peaks at switches, for the distance is assumed."""
    one, known = runs["straight-ik"], runs["known"]
    late = _peak_delay(one)
    apart, left = (abs(np.subtract(*_peaks_by_way(trace))) for trace in (one, known))
    good = late <= STROKE_S / 2 and apart > PEAKS_DIFFER_PX and left < apart / 2
    got = (
        f"peaks {late:.1f} s after the switch; far and near differ by {apart:.0f} px, with the "
        f"distance known by {left:.0f} px"
    )
    expected = (
        f"within {STROKE_S / 2:.1f} s; by more than {PEAKS_DIFFER_PX:g} px, less than half of it "
        "with the distance known"
    )
    return Answer(expected, got, good)


@statement("T10", columns="b")
def circle(runs: Traces, column: str) -> Answer:
    """Circle: all within 180 px, inverse kinematics slightly best, compensation no clear gain."""
    traces = [runs[f"circle-{law}"] for law in ("pi", "pi_hc", "ik")]
    pi, hc, ik = (_rms(one.total) for one in traces)
    peak = max(one.total.max() for one in traces)
    got = f"largest peak {peak:.0f} px; rms PI {pi:.0f}, compensated {hc:.0f}, IK {ik:.0f} px"
    good = peak <= 180 and ik < min(pi, hc) and hc > 0.9 * pi
    return Answer("180 px at most, IK lowest, compensation gains less than 10 %", got, good)


@statement("T11", columns="b")
def ik_is_rough(runs: Traces, column: str) -> Answer:
    """Circle: inverse kinematics is less smooth, vibrates near 3 s, and blurs more."""
    traces = [runs[f"circle-{law}"] for law in ("ik", "pi", "pi_hc")]
    overall = [_rms(one.breaks()[25:]) for one in traces]
    near = [_rms(one.breaks()[_within(one.t[1:-1], 3.0)]) for one in traces]
    blur = [one.blur() for one in traces]
    got = "; ".join(
        f"{what}: IK {ik:.2f}, PI {pi:.2f}, compensated {hc:.2f} px"
        for what, (ik, pi, hc) in (
            ("second differences", overall),
            ("near 3 s", near),
            ("blur", blur),
        )
    )
    good = all(ik > max(others) for ik, *others in (overall, near, blur))
    return Answer("all three larger than of PI with and without compensation", got, good)


@statement("T12", columns="b")
def both_axes(runs: Traces, column: str) -> Answer:
    """Circle: compensation works on both axes; switched off early, an extra peak in x at 13 s."""
    pi, hc = runs["circle-pi"], runs["circle-pi_hc"]
    works = all(_rms(hc.error[:, axis]) < _rms(pi.error[:, axis]) for axis in (0, 1))
    n = min(len(pi.t), len(hc.t))
    near = _within(hc.t[:n], 13.0)
    extra = float((np.abs(hc.error[:n, 0]) - np.abs(pi.error[:n, 0]))[near].max())
    off = bool((hc.compensation[_within(hc.handle_t, 13.0), 1] == 0).any())
    got = (
        f"rms x {_rms(hc.error[:, 0]):.0f} for {_rms(pi.error[:, 0]):.0f}, y "
        f"{_rms(hc.error[:, 1]):.0f} for {_rms(pi.error[:, 1]):.0f} px; near 13 s up to "
        f"{extra:.0f} px more than PI in x, {'once' if off else 'never'} switched off there"
    )
    good = works and extra >= 20 and off
    return Answer("smaller on both axes; 20 px more near 13 s, switched off there", got, good)


@statement("T13")
def large_at_turns(runs: Traces, column: str) -> Answer:
    """Straight, PI, the tip following: a large error after each switch, because of hysteresis."""
    one, other = runs["straight-pi"], runs["free"]
    with_, free = (_error_after_turns(trace) for trace in (one, other))
    follows = one.tip_deg(2 * STROKE_S) >= FOLLOWED * needed_deg()
    got = (
        f"within 1.5 s after a switch up to {with_:.0f} px, without hysteresis {free:.0f} px; tip "
        f"{_tip(one)} and {_tip(other)}"
    )
    expected = "1.5 times that without hysteresis, or more; the tip follows by half or more"
    return Answer(expected, got, follows and with_ >= 1.5 * free)


@statement("T14", columns="b")
def latency_limits(runs: Traces, column: str) -> Answer:
    """Straight: the latency of 0.4 s limits the performance."""
    names = [f"-{latency:g}s" for latency in LATENCIES_S] + [""]
    rms = {law: [_rms(runs[f"straight-{law}{n}"].total) for n in names] for law in LAWS[1:]}
    got = "; ".join(f"{law} {', '.join(f'{v:.0f}' for v in of)} px" for law, of in rms.items())
    good = all(a < b < c and c >= 1.1 * a for a, b, c in rms.values())
    expected = "rms at 0, 0.2, 0.4 s rises with every law, from 0 to 0.4 s by 10 % or more"
    return Answer(expected, got, good)


def _rms(values: Vector) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _tip(one: Trace) -> str:
    return f"{one.tip_deg(2 * STROKE_S):.0f} deg"


def _within(t: Vector, moment: float) -> NDArray[np.bool_]:
    """Which times lie near one that the excerpt tells in whole seconds."""
    return np.asarray(np.abs(t - moment) <= NEAR_S)


def _breaks(one: Trace) -> list[float]:
    """Largest break of the course of x near each time of T5 [px]."""
    size = np.abs(np.diff(one.error[:, 0], 2))
    return [float(size[_within(one.t[1:-1], moment)].max()) for moment in DISCONTINUITIES_S]


def _peaks_by_way(one: Trace) -> tuple[float, float]:
    """Mean peak of the strokes out, without the first, and of those back [px]."""
    strokes = one.strokes()
    return float(strokes[2::2].mean()), float(strokes[1::2].mean())


def _turns(one: Trace) -> Vector:
    """Times at which the target's direction switches, as delayed [s], without the start."""
    return np.arange(STROKE_S, one.t[-1] - 1.5, STROKE_S) + LATENCY_S


def _error_after_turns(one: Trace) -> float:
    """Largest error within 1.5 s of the switches, mean over them [px]."""
    t, size = one.t, one.total
    return float(np.mean([size[(t > at) & (t < at + 1.5)].max() for at in _turns(one)]))


def _peak_delay(one: Trace) -> float:
    """Time from a switch of direction to the peak of the stroke, mean over them [s]."""
    late = []
    for at in _turns(one):
        part = (one.t >= at) & (one.t < at + STROKE_S)
        late.append(float(one.t[part][one.total[part].argmax()] - at))
    return float(np.mean(late))


def _moved(one: Trace, start: float, end: float) -> float:
    """Change of the offset while the handle went from turn to turn, as seen later [px]."""
    x = np.interp([start + LATENCY_S, end + LATENCY_S], one.t, one.error[:, 0])
    return float(abs(x[1] - x[0]))
