"""`endolock board`: boards for the bench, printed or moving on a screen."""

from __future__ import annotations

import html
import json
import math
import webbrowser
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console

import endolock
from endolock.hw import boards
from endolock.hw.api import ConfigError
from endolock.hw.boards import PrintedBoard
from endolock.hw.files import write_whole
from endolock.scripts.figures import board_svg
from endolock.twin.world import scenario as scenarios
from endolock.twin.world.playback import Course
from endolock.twin.world.scenario import Scenario

RATE_HZ = 100.0
"""Sampling rate of the path in a page [Hz]."""
LONGEST_S = 3600.0
"""Maximum duration of the path in a page [s]."""
OTHER = "use another --out"
"""Next step if a file cannot be written."""

_File = Annotated[tyro.conf.DisallowNone[Path | None], tyro.conf.arg(metavar="FILE")]
_Play = Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="SCENARIO")]


@dataclass(frozen=True, kw_only=True)
class Request:
    """Write a board to print, or a page that moves it on a screen along a scenario's path."""

    out: _File = None
    """SVG file to write, in true size; with --play the page, default: board-SCENARIO.html."""
    kind: tyro.conf.DisallowNone[str | None] = None
    """Board: rings, tissue or several; default: rings, with --play the scenario's."""
    play: _Play = None
    """Write a page that moves the board along this scenario's path, and open it if there is a
    screen. Tilt, shaft, pushes and occluders are not shown."""


def main(request: Request) -> int:
    """Carry out `endolock board`; return the exit code."""
    console = Console()
    if request.play is not None:
        scenario = scenarios.load(request.play)
        path = _named(request.out or Path(f"board-{scenario.name}.html"), ".html", "the page")
        write_whole(path, page(scenario, request.kind or scenario.board.kind), OTHER)
        opened = endolock.has_screen() and webbrowser.open(path.resolve().as_uri())
        message = f"wrote and opened {path}" if opened else f"wrote {path}; open it in any browser"
    elif request.out is not None:
        path = _named(request.out, ".svg", "the board to print")
        write_whole(path, board_svg.sheet(find(request.kind or "rings")), OTHER)
        message = f"wrote {path}; print it at 100 % and measure its ruler"
    else:
        raise ConfigError(
            "neither --out nor --play", "give --out FILE.svg to print a board, or --play SCENARIO"
        )
    console.print(message, soft_wrap=True, highlight=False, markup=False)
    return 0


def find(kind: str) -> PrintedBoard:
    """Return a board by name.

    Raises:
        ConfigError: no board has this name.
    """
    known = boards.all_boards()
    if kind not in known:
        raise ConfigError(f"kind '{kind}' is unknown", f"use {', '.join(sorted(known))}")
    return known[kind]


def page(scenario: Scenario, kind: str) -> str:
    """Return the page that moves a board, with everything it needs.

    Args:
        scenario: the scenario whose path the board follows, with seed 0.
        kind: name of the board.

    Raises:
        ConfigError: no such board, or the scenario is too long.
    """
    board = find(kind)
    if scenario.duration_s > LONGEST_S:
        raise ConfigError(
            f"scenario {scenario.name}: duration_s {scenario.duration_s:g} is above the maximum "
            f"of {LONGEST_S:g} for a page",
            "use a scenario file with a shorter duration_s",
        )
    course = Course(scenario, seed=0)
    times = np.arange(math.ceil(scenario.duration_s * RATE_HZ) + 1) / RATE_HZ
    record = {
        "name": scenario.name,
        "duration_s": scenario.duration_s,
        "rate_hz": RATE_HZ,
        "side_mm": board.geometry.size_m * 1e3,
        "path_mm": [[round(c * 1e3, 4) for c in course.board(float(t))] for t in times],
    }
    half = board.geometry.size_m * 500
    text = (files("endolock") / "scripts" / "commands" / "board_page.html").read_text(
        encoding="utf-8"
    )
    for mark, value in {
        "@TITLE@": html.escape(f"{scenario.name}, board {kind}"),
        "@BOX@": f"{-half:g} {-half:g} {2 * half:g} {2 * half:g}",
        "@BOARD@": board_svg.elements(board),
        "@DATA@": json.dumps(record, allow_nan=False).replace("<", "\\u003c"),
    }.items():
        text = text.replace(mark, value)
    return text


def _named(path: Path, ending: str, what: str) -> Path:
    if path.suffix.lower() != ending:
        raise ConfigError(
            f"cannot write {what} as {path}", f"give --out a name that ends in {ending}"
        )
    return path
