"""Run records as a table for people, with what a handle that never moves would have scored."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any, Literal

from rich import box
from rich.markup import escape
from rich.table import Table

CONSTANT = "constant: the best that a handle which never moves could do, known in hindsight"
LONG_NAME = 11
"""A law with a longer name takes the place of two columns: a table has 80 characters."""


def table(records: Sequence[dict[str, Any]]) -> Table:
    """Lay run records out for people.

    Errors are in pixels, *seen* is the rms of what vision saw, *tip* and *handle* are angles from
    peak to peak of the axis that moved farther, *found* the share of frames in which the target
    was, *lost* that of the ticks without a lock, *speed* simulated seconds a second. The last
    row of each scenario is that of the best constant handle.
    """
    latencies = {record["latency_s"] for record in records}
    title = escape("error [px], now and as seen; tip, handle p-p [deg]")
    if len(latencies) == 1:
        title += f"; latency {latencies.pop():.2f} s"
    result = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    rows = [_cells(record) for record in with_constants(records)]
    # All would not fit 80 characters.
    left_out = {"found", "speed"} if latencies else {"latency"}
    if any(record.get("variation") for record in records):
        left_out |= {"p95", "seen", "found", "speed"}
    else:
        left_out.add("variation")
    if len({record["seed"] for record in records}) == 1:
        left_out.add("seed")
    else:
        left_out |= {"found", "speed"}
    if any(len(record["controller"]) > LONG_NAME for record in records):
        left_out |= {"found", "speed"}
    headings = [name for name in rows[0] if name not in left_out]
    for heading in headings:
        left = heading in ("scenario", "law", "variation")
        whole = heading not in ("scenario", "variation")
        justify: Literal["left", "right"] = "left" if left else "right"
        result.add_column(heading, justify=justify, overflow="fold", no_wrap=whole)
    for row in rows:
        result.add_row(*(row[heading] for heading in headings))
    return result


def legend(records: Sequence[dict[str, Any]]) -> list[str]:
    """Say what is not plain from a table."""
    constant = any(record["constant_px"] for record in records)
    return [*([CONSTANT] if constant else []), "tip, handle: of the axis that moved farther"]


def with_constants(records: Sequence[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Add rows for the best constant handle below the laws of each scenario.

    Args:
        records: run records, one scenario after another.
    """
    unknown = (
        *("delayed_error_px", "vision_error_px"),
        *("detected_fraction", "lost_fraction", "real_time_factor"),
    )
    nothing = {key: {"p2p_deg": (0.0, 0.0)} for key in ("tip", "handle")}
    for _, block in groupby(records, key=lambda record: record["scenario"]):
        told: list[Any] = [None]  # on a bench, or where the tip is pushed
        yield from (rows := list(block))
        for record in rows:
            constant = record["constant_px"]
            if constant not in told and not record["interrupted"]:  # of another time
                told.append(constant)
                row = {"controller": "constant", "latency_s": None, "error_px": constant}
                yield record | dict.fromkeys(unknown) | nothing | row


def _cells(r: dict[str, Any]) -> dict[str, str]:
    error, seen = r["error_px"] or {}, r["delayed_error_px"] or {}
    return {
        "scenario": escape(r["scenario"]),
        "law": escape(r["controller"]),
        "variation": escape(r.get("variation") or "nominal"),
        "seed": str(r["seed"]),
        "latency": "-" if r["latency_s"] is None else f"{r['latency_s']:.2f} s",
        **{key: _number(error.get(key)) for key in ("rms", "p95", "max")},
        "seen": _number(seen.get("rms")),
        "tip": _degrees(r["tip"]),
        "handle": _degrees(r["handle"]),
        "found": _percent(r["detected_fraction"]),
        "lost": _percent(r["lost_fraction"]),
        "speed": _number(r["real_time_factor"], "x"),
    }


def _degrees(motion: dict[str, Any] | None) -> str:
    both = motion and motion["p2p_deg"]
    return f"{max(both):.0f}" if both else "-"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.0f} %"


def _number(value: float | None, unit: str = "") -> str:
    """Write a number with one decimal, or whole where that would be a fourth digit."""
    return "-" if value is None else f"{value:.{1 if abs(value) < 99.95 else 0}f}{unit}"
