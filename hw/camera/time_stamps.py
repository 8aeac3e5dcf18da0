"""The time stamps of a recorded video: a CSV file with one row per picture."""

from __future__ import annotations

import csv
from itertools import pairwise
from math import isfinite
from pathlib import Path
from statistics import median

from endolock.hw.api import ConfigError

LONGEST_LATENCY_S = 10.0
"""Largest time from exposure to delivery [s]. Assumed, as in a bench file."""
LONGEST_PERIOD_S = 10.0
"""Largest median time between pictures [s]. Assumed: milliseconds given for seconds are above."""
COLUMNS = ("t_capture", "t_available")


def read(path: Path) -> list[tuple[float, float]]:
    """Read the time stamps of a video.

    Its columns are `t_capture` and `t_available` [s]; with only one of them the latency is zero.

    Returns:
        Both times of each picture [s].

    Raises:
        ConfigError: it cannot be read, a time is not later than the one in the row above, or was
            captured after it was delivered.
    """
    advice = "give seconds in one or both of the columns t_capture and t_available"
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            header = list(reader.fieldnames or ())
            rows = [(f"row {n} (line {reader.line_num})", row) for n, row in enumerate(reader, 1)]
    except (OSError, ValueError, csv.Error) as error:
        raise ConfigError(f"cannot read {path}: {error}", "give a CSV file") from None
    known = [name for name in COLUMNS if name in header]
    if not known or not rows:
        missing = (
            "no row below its header" if known else "none of the columns t_capture, t_available"
        )
        raise ConfigError(f"{path} has {missing}", advice)
    if twice := [name for name in known if header.count(name) > 1]:
        raise ConfigError(f"{path} has the column {twice[0]} twice", "remove one of them")
    stamps = []
    for where, row in rows:
        early, late = (_seconds(path, where, name, row[name]) for name in (known[0], known[-1]))
        if not 0 <= late - early <= LONGEST_LATENCY_S:
            raise ConfigError(
                f"{path}, {where}: captured at {early:.10g} s, delivered at {late:.10g} s, wanted "
                f"0 to {LONGEST_LATENCY_S:g} s later",
                "exchange the columns if they are swapped; give seconds",
            )
        stamps.append((early, late))
    for (_, before), (where, row) in pairwise(rows):
        for name in known:
            old, new = float(before[name]), float(row[name])
            if new <= old:
                same = "the same as in" if new == old else f"before {old:.10g} s in"
                raise ConfigError(
                    f"{path}, {where}: {name} is {new:.10g} s, {same} the row above",
                    "give one row per picture, in order of time",
                )
    steps = [after - before for (_, before), (_, after) in pairwise(stamps)]
    if steps and median(steps) > LONGEST_PERIOD_S:
        raise ConfigError(
            f"{path}: pictures are {median(steps):g} s apart, wanted up to {LONGEST_PERIOD_S:g} s",
            "give seconds, not milliseconds",
        )
    return stamps


def _seconds(path: Path, where: str, name: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except (TypeError, ValueError):
        value = float("nan")
    if not isfinite(value):
        raise ConfigError(f"{path}, {where}: {name} is {text!r}", "give a number in every row")
    return value
