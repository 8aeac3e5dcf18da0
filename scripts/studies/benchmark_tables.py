"""Tables of the benchmark: errors, their price, and where a law loses, from finished runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

from endolock.scripts.runs import theory
from endolock.scripts.runs.batch import FinishedRun
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.markdown_table import markdown_table

SIMPLE = ("still", "pi", "pi_simc", "ik_sync")
"""What a lock should never be worse than: doing nothing, and the laws without memory."""
RMS_TIMES, RMS_MORE_PX = 1.05, 1.0
MAX_TIMES, MAX_MORE_PX = 1.15, 5.0
"""What counts as worse: more than the best of `SIMPLE` by this factor and this error [px]. Assumed;
the largest error of one run is a matter of luck, so it may differ more."""
LOST = 0.01
"""Share of the time out of sight that is mentioned [1]."""


class Planned(NamedTuple):
    """One run of the benchmark."""

    scenario: str
    law: str
    vary: tuple[str, ...] = ()
    latency_s: float | None = None
    rig: str = "twin"


class Case(NamedTuple):
    """One row of a part: a task for all of its controllers."""

    cells: tuple[str, ...]
    """First cells of the row."""
    scenario: str
    vary: tuple[str, ...] = ()
    latency_s: float | None = None
    rig: str = "twin"
    last: str = ""
    """Last cell of the row, where the part has such a column."""

    def planned(self, law: str) -> Planned:
        """Return its run with a controller."""
        return Planned(self.scenario, law, self.vary, self.latency_s, self.rig)


class Part(NamedTuple):
    """One part of the page."""

    title: str
    heads: tuple[str, ...]
    """Headings of the first columns."""
    laws: tuple[str, ...]
    """Controllers."""
    cases: tuple[Case, ...]
    last: str = ""
    """Heading of a further column of the table of errors."""

    def runs(self) -> Iterator[Planned]:
        """Yield all of its runs."""
        return (case.planned(law) for case in self.cases for law in self.laws)


Results = Mapping[Planned, FinishedRun | None]
"""Finished runs; None where a controller cannot be used on a task."""


def tables(part: Part, results: Results, described: Callable[[Planned], Experiment]) -> str:
    """Lay out one part: the errors, the motion of tip and handle, and how the handles turn.

    Args:
        part: its controllers and rows.
        results: results of all of its runs.
        described: returns the experiment of a run.
    """
    errors, motions, turns = [], [], []
    for case in part.cases:
        planned = [case.planned(law) for law in part.laws]
        own = [results[one] for one in planned]
        known = next(one for one in own if one)
        cells = [_error(described(p), one) for p, one in zip(planned, own, strict=True)]
        more = [case.last] if part.last else []
        errors.append([*case.cells, *cells, f"{known.constant_px:.1f}", *more])
        motions.append([*case.cells, *map(_motion, own), f"{known.needed_deg:.0f}"])
        turns.append([*case.cells, *map(_turns, own)])
    head = [*part.heads, *part.laws]
    error_head = [*head, "constant", *([part.last] if part.last else [])]
    return (
        f"\n## {part.title}\n\nError, rms / max in px:\n\n{markdown_table(error_head, errors)}"
        f"\nTip / handle, peak to peak in deg:\n\n{markdown_table([*head, 'tip needed'], motions)}"
        "\nHandles, travel in rad/s / reversals by 0.1 rad per s / share of the time above 2 rad/s:"
        f"\n\n{markdown_table(head, turns)}"
    )


def losses(parts: Sequence[Part], results: Results, law: str) -> list[str]:
    """List the rows in which a law is worse than the best of `SIMPLE`, one line of Markdown each.

    Args:
        parts: the parts of the page.
        results: results of all of their runs.
        law: name of the controller.
    """
    lines, listed = [], set()
    for part in parts:
        for case in part.cases:
            own = results.get(case.planned(law))
            rivals = {
                name: found
                for name in SIMPLE
                if name in part.laws and (found := results.get(case.planned(name)))
            }
            if own is None or not rivals or case.planned(law) in listed:
                continue
            listed.add(case.planned(law))  # the same task may be a row of several parts
            said = list(_said(own, rivals))
            if said:
                lines.append(f"- {part.title}, {', '.join(case.cells)}: {'; '.join(said)}.")
    return lines


def _said(own: FinishedRun, rivals: Mapping[str, FinishedRun]) -> Iterator[str]:
    """Say in which respect a run is worse than others."""
    rms = {name: run.rms for name, run in rivals.items()}
    largest = {name: run.max_px for name, run in rivals.items()}
    for what, value, others, times, more in (
        ("rms", own.rms, rms, RMS_TIMES, RMS_MORE_PX),
        ("max", own.max_px, largest, MAX_TIMES, MAX_MORE_PX),
    ):
        best = min(others, key=others.__getitem__)
        if value > times * others[best] + more:
            yield f"{what} {value:.1f} px, `{best}` {others[best]:.1f} px"
    if own.lost > LOST and own.lost > min(run.lost for run in rivals.values()) + LOST:
        yield f"out of sight for {100 * own.lost:.0f} % of the time"


def _error(experiment: Experiment, done: FinishedRun | None) -> str:
    if done is None:
        return "-"
    marks = []
    if done.lost > LOST:
        marks.append(f"lost {100 * done.lost:.0f} %")
    if (margins := _margins(experiment)) and margins["gain"] < 1:
        marks.append("unstable")
    return f"{done.rms:.1f} / {done.max_px:.0f}" + (f" ({', '.join(marks)})" if marks else "")


def _margins(experiment: Experiment) -> dict[str, float] | None:
    task = experiment.resolve()
    margins: dict[str, float] | None = theory.of(task.scenario, task.settings)["margins"]
    return margins


def _motion(done: FinishedRun | None) -> str:
    return "-" if done is None else f"{done.tip_deg:.0f} / {done.handle_deg:.0f}"


def _turns(done: FinishedRun | None) -> str:
    if done is None:
        return "-"
    travel, large, fast = done.handles
    return f"{travel:.2f} / {large:.2f} / {100 * fast:.0f} %"
