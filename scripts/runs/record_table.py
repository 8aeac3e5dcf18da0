"""Run records as a printed table, with the error of the best constant handle angle."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any, Literal

from rich import box
from rich.markup import escape
from rich.table import Table

from endolock.control.scores import ErrorSummary, HandleScores, TipScores
from endolock.scripts.runs.run_record import RunRecord

CONSTANT = "constant: the best constant handle angle, known in hindsight"
LONG_NAME = 11
"""A controller with a longer name takes the width of two columns: a table has 80 characters."""


def table(records: Sequence[RunRecord]) -> Table:
    """Lay run records out as a table.

    Errors are in pixels, *seen* is the rms of the error that vision
    measured, *tip* and *handle* are
    peak-to-peak angles on the axis that moved more, *found* is the fraction of frames in which
    the target was found, *start* and *worst* the rms and the largest error before the scored part,
    *lost* the fraction of ticks without a lock, *speed* simulated time over
    wall-clock time. The last row of each scenario is that of the best constant handle angle.
    """
    latencies = {record.latency_s for record in records}
    title = escape("error [px], now and as seen; tip, handle p-p [deg]")
    if len(latencies) == 1:
        title += f"; latency {latencies.pop():.2f} s"
    result = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    rows = [_cells(record) for record in with_constants(records)]
    # All columns would not fit into 80 characters.
    left_out = {"found", "speed"} if latencies else {"latency"}
    if any(record.variation for record in records):
        left_out |= {"p95", "seen", "found", "speed"}
    else:
        left_out.add("variation")
    if len({record.seed for record in records}) == 1:
        left_out.add("seed")
    else:
        left_out |= {"found", "speed"}
    if any(len(record.controller) > LONG_NAME for record in records):
        left_out |= {"found", "speed"}
    if all(record.startup_error_px in (None, ErrorSummary()) for record in records):
        left_out |= {"start", "worst"}
    else:
        left_out |= {"found", "speed", "seen"}
    headings = [name for name in rows[0] if name not in left_out]
    for heading in headings:
        left = heading in ("scenario", "law", "variation")
        whole = heading not in ("scenario", "variation")
        justify: Literal["left", "right"] = "left" if left else "right"
        result.add_column(heading, justify=justify, overflow="fold", no_wrap=whole)
    for row in rows:
        result.add_row(*(row[heading] for heading in headings))
    return result


def handles(records: Sequence[RunRecord]) -> Table:
    """Lay out what the handles did: the price of the errors.

    *travel* is the distance of both handles per second, *reversals* the changes of direction by
    6 mrad or more and *large* those by 0.1 rad, *fast* the share of the time above 2 rad/s.
    """
    title = escape("handles: travel [rad/s], reversals by 6 mrad and 0.1 rad [1/s], over 2 rad/s")
    result = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    several = {
        "variation": any(record.variation for record in records),
        "seed": len({record.seed for record in records}) > 1,
        "latency": len({record.latency_s for record in records}) > 1,
    }
    names = ["scenario", "law", *(name for name, shown in several.items() if shown)]
    for heading in (*names, "travel", "reversals", "large", "fast"):
        left = heading in ("scenario", "law", "variation")
        result.add_column(
            heading,
            justify="left" if left else "right",
            overflow="fold",
            no_wrap=heading not in ("scenario", "variation"),
        )
    for record in records:
        cells, handle = _cells(record), record.handle
        figures = (record.travel_rad_s, handle.reversals_per_s, handle.large_reversals_per_s)
        result.add_row(
            *(cells[name] for name in names),
            *("-" if figure is None else f"{figure:.2f}" for figure in figures),
            _percent(handle.fast_share),
        )
    return result


def legend(records: Sequence[RunRecord]) -> list[str]:
    """Return the lines that explain the columns of a table."""
    constant = any(record.constant_px and not record.interrupted for record in records)
    learnt = sorted({record.scored_from_s for record in records if record.scored_from_s})
    start = f"start, worst: rms and largest error before {learnt[0]:g} s" if learnt else ""
    tip = "tip, handle: on the axis that moved more"
    return [line for line in (CONSTANT if constant else "", start, tip) if line]


def with_constants(records: Sequence[RunRecord]) -> Iterator[RunRecord]:
    """Add rows for the best constant handle angle below the controllers of each scenario.

    Args:
        records: run records, one scenario after another.
    """
    at_rest = (0.0, 0.0)
    for _, block in groupby(records, key=lambda record: record.scenario):
        listed: list[Any] = [None]  # None: on a bench, or where the tip is pushed
        yield from (rows := list(block))
        for record in rows:
            constant = record.constant_px
            if constant not in listed and not record.interrupted:  # its path is shorter
                listed.append(constant)
                yield replace(
                    record,
                    controller="constant",
                    latency_s=None,
                    error_px=constant,
                    startup_error_px=None,
                    delayed_error_px=ErrorSummary(),
                    vision_error_px=None,
                    detected_fraction=None,
                    lost_fraction=None,
                    real_time_factor=None,
                    handle=HandleScores(p2p_deg=at_rest),
                    tip=TipScores(p2p_deg=at_rest),
                )


def _cells(r: RunRecord) -> dict[str, str]:
    error, seen = r.error_px or ErrorSummary(), r.delayed_error_px
    start = r.startup_error_px or ErrorSummary()
    return {
        "scenario": escape(r.scenario),
        "law": escape(r.controller),
        "variation": escape(r.variation or "nominal"),
        "seed": str(r.seed),
        "latency": "-" if r.latency_s is None else f"{r.latency_s:.2f} s",
        "rms": _number(error.rms),
        "p95": _number(error.p95),
        "max": _number(error.max),
        "seen": _number(seen.rms),
        "start": _number(start.rms),
        "worst": _number(start.max),
        "tip": _degrees(r.tip.p2p_deg if r.tip else None),
        "handle": _degrees(r.handle.p2p_deg),
        "found": _percent(r.detected_fraction),
        "lost": _percent(r.lost_fraction),
        "speed": _number(r.real_time_factor, "x"),
    }


def _degrees(both: Sequence[float] | None) -> str:
    return f"{max(both):.0f}" if both else "-"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.0f} %"


def _number(value: float | None, unit: str = "") -> str:
    """Format a number with one decimal; without decimals from 100 on."""
    return "-" if value is None else f"{value:.{1 if abs(value) < 99.95 else 0}f}{unit}"
