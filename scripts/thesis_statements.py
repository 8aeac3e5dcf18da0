"""The thirteen statements of the excerpt, each as a question to runs (see `thesis`).

What is not stated for a column has no expectation. Bounds are read off the axis limits of the
excerpt's plots; where it says "around", "slightly" or "comparable", the tolerance is assumed and
stands in the expectation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from endolock.hw.api import Vector
from endolock.scripts.thesis import LATENCY_S, STROKE_S, Trace

VISIBLE_PX = 2.0
"""Smaller breaks of a course cannot be seen in the excerpt's plots: 1 % of their height [px]."""
Traces = Mapping[str, Trace]


class Answer(NamedTuple):
    """What one statement comes to in one column."""

    expected: str | None
    """In words; None where the excerpt does not say."""
    got: str
    ok: bool


Question = Callable[[Traces, str], Answer]
QUESTIONS: dict[str, tuple[Question, str, str]] = {}
"""Each with the columns that the excerpt speaks of, and its basis."""


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
                    "basis": basis,
                }
            )
    return rows


def statement(name: str, columns: str = "ab", basis: str = "predicted") -> Callable[..., Question]:
    """Enter a question."""

    def enter(question: Question) -> Question:
        QUESTIONS[name] = question, columns, basis
        return question

    return enter


@statement("T1", basis="calibrated")
def straight_pi(runs: Traces, column: str) -> Answer:
    """Straight, PI: peak."""
    low, high = (180, 200) if column == "a" else (200, 250)
    strokes = runs["straight-pi"].strokes()
    peak, later = runs["straight-pi"].total.max(), strokes[1:].max()
    return Answer(
        f"{low} to {high} px",
        f"{peak:.0f} px; after the first stroke {later:.0f} px",
        low < peak <= high,
    )


@statement("T2", basis="calibrated")
def straight_gain(runs: Traces, column: str) -> Answer:
    """Straight, compensation brings the target closer by."""
    strokes = runs["straight-pi"].strokes() - runs["straight-pi_hc"].strokes()
    gain = float(strokes.mean())
    return Answer("65 +- 10 px", f"{gain:.0f} px, mean of stroke peaks", abs(gain - 65) <= 10)


@statement("T3")
def straight_compensated(runs: Traces, column: str) -> Answer:
    """Straight, PI with compensation: peak."""
    bound = 150 if column == "a" else 180
    peak = runs["straight-pi_hc"].total.max()
    return Answer(f"{bound} px at most", f"{peak:.0f} px", peak <= bound)


@statement("T4")
def straight_ik(runs: Traces, column: str) -> Answer:
    """Straight, inverse kinematics against PI with compensation."""
    pi, hc, ik = (_rms(runs[f"straight-{law}"].total) for law in ("pi", "pi_hc", "ik"))
    peak = runs["straight-ik"].total.max()
    got = f"peak {peak:.0f} px, rms {ik:.0f} px (compensated {hc:.0f}, PI {pi:.0f})"
    if column == "a":
        good = peak <= 150 and 0.75 * hc <= ik < hc
        return Answer("150 px at most, rms up to 25 % lower than compensated", got, good)
    good = peak <= 180 and 0.75 * min(pi, hc) <= ik <= 1.25 * max(pi, hc)
    return Answer("180 px at most, rms within 25 % of PI with and without", got, good)


@statement("T5")
def discontinuities(runs: Traces, column: str) -> Answer:
    """Small discontinuities at the direction switches, for the width is slightly too large."""
    with_, without = (_near_turns(runs[f"straight-{law}"]) for law in ("pi_hc", "pi"))
    got = f"course breaks by {with_:.1f} px there, without compensation by {without:.1f} px"
    if column == "a":
        return Answer(f"none to be seen: {VISIBLE_PX:g} px at most", got, with_ <= VISIBLE_PX)
    return Answer(
        f"more than {VISIBLE_PX:g} px, and than without", got, with_ > max(VISIBLE_PX, without)
    )


@statement("T6", columns="a")
def two_peaks(runs: Traces, column: str) -> Answer:
    """Compensation is larger at every other stroke (8 and 18 s): two different peaks."""
    gain = runs["straight-pi"].strokes() - runs["straight-pi_hc"].strokes()
    out, back = gain[2::2].mean(), gain[1::2].mean()
    got = f"gain on the way out {out:.0f} px, on the way back {back:.0f} px"
    return Answer("gains differ by more than 10 px", got, abs(out - back) > 10)


@statement("T7", basis="provoked")
def over_compensated(runs: Traces, column: str) -> Answer:
    """A width over-estimated further makes it unstable."""
    plain, over = runs["straight-pi_hc"], runs["over"]
    rate, growth = len(over.turns(1)) / over.t[-1], _rms(over.total) / _rms(plain.total)
    got = f"at 0.3 {rate:.1f} handle turns a second, {growth:.1f} times the rms at 0.2"
    expected = "more than one turn a second, and 1.5 times the rms"
    return Answer(expected, got, rate > 1 and growth > 1.5)


@statement("T8", columns="b")
def handle_and_offset(runs: Traces, column: str) -> Answer:
    """Fig 6.5: handle over 80 deg, offset within 200 px, fast turns that hardly move the target."""
    one = runs["straight-pi_hc"]
    sweep, offset = float(np.ptp(one.handle[:, 1])), float(np.abs(one.error[:, 0]).max())
    quiet = [size for a, b, size in one.turns(1) if b - a < 0.6 and _moved(one, a, b) < 30]
    largest = max(quiet, default=0.0)
    good = 60 <= sweep <= 100 and offset <= 200 and largest >= 20
    got = f"{sweep:.0f} deg, {offset:.0f} px, fast turns of up to {largest:.0f} deg"
    return Answer("80 +- 20 deg, 200 px at most, fast turns of 20 deg or more", got, good)


@statement("T9", columns="b")
def ik_peaks(runs: Traces, column: str) -> Answer:
    """Straight, inverse kinematics: the error peaks where the target switches direction."""
    return _after_turns(runs["straight-ik"], 0.5)


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
    """Circle: inverse kinematics is less smooth."""
    rough = [_rms(runs[f"circle-{law}"].breaks()[25:]) for law in ("pi", "pi_hc", "ik")]
    got = f"second differences: IK {rough[2]:.2f}, PI {rough[0]:.2f}, compensated {rough[1]:.2f} px"
    return Answer("rougher than PI with and without compensation", got, rough[2] > max(rough[:2]))


@statement("T12", columns="b", basis="provoked")
def both_axes(runs: Traces, column: str) -> Answer:
    """Circle: compensation works on both axes; switched off too early, an extra peak in x."""
    pi, hc, early = (runs[name].error for name in ("circle-pi", "circle-pi_hc", "early"))
    works = all(_rms(hc[:, axis]) < _rms(pi[:, axis]) for axis in (0, 1))
    n = min(len(early), len(hc))
    extra = float((np.abs(early[:n, 0]) - np.abs(hc[:n, 0])).max())
    got = (
        f"rms x {_rms(hc[:, 0]):.0f} for {_rms(pi[:, 0]):.0f}, y {_rms(hc[:, 1]):.0f} for "
        f"{_rms(pi[:, 1]):.0f} px; switched off early up to {extra:.0f} px more in x"
    )
    return Answer("smaller on both axes; a peak of 20 px or more", got, works and extra >= 20)


@statement("T13")
def large_at_turns(runs: Traces, column: str) -> Answer:
    """Straight, PI: a large error follows each direction switch, because of hysteresis."""
    with_, free = (_error_after_turns(runs[name]) for name in ("straight-pi", "free"))
    got = f"within 1.5 s after a switch up to {with_:.0f} px, without hysteresis {free:.0f} px"
    return Answer("1.5 times that without hysteresis, or more", got, with_ >= 1.5 * free)


def _rms(values: Vector) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _turns(one: Trace) -> Vector:
    """Times at which the target's direction switches, as delayed [s], without the start."""
    return np.arange(STROKE_S, one.t[-1] - 1.5, STROKE_S) + LATENCY_S


def _near_turns(one: Trace) -> float:
    """Largest break of the course within 1.5 s of the switches, median over them [px]."""
    t, size = one.t[1:-1], np.abs(one.breaks())
    return float(np.median([size[(t > at) & (t < at + 1.5)].max() for at in _turns(one)]))


def _error_after_turns(one: Trace) -> float:
    """Largest error within 1.5 s of the switches, mean over them [px]."""
    t, size = one.t, one.total
    return float(np.mean([size[(t > at) & (t < at + 1.5)].max() for at in _turns(one)]))


def _after_turns(one: Trace, most: float) -> Answer:
    """Whether the peak of each stroke comes within the first part of it."""
    late = []
    for at in _turns(one):
        part = (one.t >= at) & (one.t < at + STROKE_S)
        late.append(float((one.t[part][one.total[part].argmax()] - at) / STROKE_S))
    mean = float(np.mean(late))
    got = f"peaks come {mean * STROKE_S:.1f} s after the switch, of strokes of {STROKE_S} s"
    return Answer(f"within {most * STROKE_S:.1f} s", got, mean <= most)


def _moved(one: Trace, start: float, end: float) -> float:
    """Change of the offset while the handle went from turn to turn, as seen later [px]."""
    x = np.interp([start + LATENCY_S, end + LATENCY_S], one.t, one.error[:, 0])
    return float(abs(x[1] - x[0]))
