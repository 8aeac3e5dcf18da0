"""`endolock board`: the printed board at true scale, and one that moves on a screen.

The page that `--play` writes shows the board along a scenario's path, lit by the screen itself, and
keeps the time of every picture it draws: a target mover for the bench.
"""

from __future__ import annotations

import base64
import json
import webbrowser
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import tyro
from rich.console import Console

import endolock
from endolock.hw.api import ConfigError
from endolock.twin import board as boards
from endolock.twin import scenario as scenarios
from endolock.twin import tissue
from endolock.twin.course import Course

EDGE_MM = 10.0
"""White around the board on the sheet [mm]."""
RULER_MM = 50
RATE_HZ = 100.0
"""Places of the board in a page, joined by lines [1/s]."""
TISSUE_TEXELS_PER_MM = 24
MODULES = 6
"""Cells to a side of a marker, black border included."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Draw a board to be printed at true scale, or a page on which it moves along a scenario."""

    out: tyro.conf.DisallowNone[Path | None] = None
    """File to write: .svg to print, .html with --play."""
    play: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="SCENARIO")] = None
    """Write a page that shows the board moving along this scenario, with time stamps."""
    kind: tyro.conf.DisallowNone[str | None] = None
    """rings, tissue or several; else that of the scenario, or rings."""


def main(request: Request) -> int:
    """Carry out `endolock board`; return the exit code."""
    known = boards.prints()
    if request.kind is not None and request.kind not in known:
        raise ConfigError(f"board '{request.kind}' is unknown; use {', '.join(known)}")
    console = Console(highlight=False, soft_wrap=True)
    if request.play is not None:
        scenario = scenarios.load(request.play)
        out = request.out or Path(f"board-{scenario.name}.html")
        _check(out, ".html")
        _write(out, page(scenario, known[request.kind or scenario.board.kind]))
        shown = endolock.has_screen() and webbrowser.open(out.resolve().as_uri())
        then = "opened in the browser" if shown else "open it in a browser, full screen"
        console.print(f"wrote {out}; {then}", markup=False)
        return 0
    if request.out is None:
        raise ConfigError("nothing to do; give --out FILE.svg to print, or --play SCENARIO")
    _check(request.out, ".svg")
    _write(request.out, sheet(known[request.kind or "rings"]))
    side = 1e3 * boards.SIZE_M
    console.print(
        f"wrote {request.out}; print it at 100 % and measure: the board is {side:.0f} mm wide",
        markup=False,
    )
    return 0


def sheet(board: boards.Print) -> str:
    """Return the SVG of a board with a cutting line and a ruler, in millimetres."""
    side = 1e3 * board.geometry.size_m
    width, height = side + 2 * EDGE_MM, side + 3 * EDGE_MM
    low, under = -side / 2 - EDGE_MM, side / 2 + EDGE_MM
    start, end = -RULER_MM / 2, RULER_MM / 2
    ticks = "".join(f"M{x:g} {under - 2:g}v4" for x in np.arange(start, end + 1, 10))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}mm" height="{height:g}mm" '
        f'viewBox="{low:g} {low:g} {width:g} {height:g}">\n{drawing(board)}'
        f'<path d="M{start:g} {under:g}h{RULER_MM}{ticks}" stroke="#000" stroke-width="0.2"/>\n'
        f'<text x="0" y="{under + 6:g}" font-size="3.5" text-anchor="middle" '
        f'font-family="sans-serif">print at 100 %: this line is {RULER_MM} mm</text>\n</svg>\n'
    )


def drawing(board: boards.Print) -> str:
    """Return the board itself as SVG elements in millimetres, its centre at 0, 0."""
    geometry = board.geometry
    half = 1e3 * geometry.size_m / 2
    paper, ink = _colour(boards.PAPER), _colour(boards.INK)
    parts = [
        f'<rect class="board" x="{-half:g}" y="{-half:g}" width="{2 * half:g}" '
        f'height="{2 * half:g}" fill="{paper}" stroke="#999" stroke-width="0.1"/>\n'
    ]
    for seed, patch in enumerate(board.patches):
        parts.append(_patch(patch, seed))
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, geometry.dictionary))
    for marker, x, y, size in geometry.markers:
        cell = 1e3 * size / MODULES
        left, top = 1e3 * (x - size / 2), 1e3 * (y - size / 2)
        # One path of squares: a viewer that smooths edges shows no seams within a black area.
        black = cv2.aruco.generateImageMarker(dictionary, marker, MODULES) == 0
        whole = f"M0 0h{MODULES}v{MODULES}h-{MODULES}z"
        holes = "".join(f"M{u} {v}v1h1v-1z" for v, u in np.argwhere(~black))
        parts.append(
            f'<path id="marker-{marker}" transform="translate({left:g} {top:g}) scale({cell:.9g})" '
            f'fill="{ink}" d="{whole}{holes}"/>\n'
        )
    return "".join(parts)


def page(scenario: scenarios.Scenario, board: boards.Print) -> str:
    """Return a page that moves the board along a scenario; it needs nothing but itself."""
    course = Course(scenario, seed=0)
    times = np.arange(round(scenario.duration_s * RATE_HZ) + 1) / RATE_HZ
    path = [[round(1e3 * c, 4) for c in course.board(float(t))] for t in times]
    template = files("endolock") / "scripts" / "board.html"
    values = {
        "name": scenario.name,
        "summary": scenario.summary,
        "rate": RATE_HZ,
        "path": path,
        "half": 1e3 * board.geometry.size_m / 2,
    }
    data = json.dumps(values).replace("<", "\\u003c")
    text = template.read_text(encoding="utf-8")
    return text.replace("@DATA@", data).replace("@BOARD@", drawing(board))


def _patch(patch: boards.Patch, seed: int) -> str:
    x, y, radius = 1e3 * patch.x, 1e3 * patch.y, 1e3 * patch.radius
    if patch.kind == "rings":
        return "".join(
            f'<circle cx="{x:g}" cy="{y:g}" r="{size:g}" fill="{_colour(colour)}"/>\n'
            for size, colour in boards.rings(radius)
        )
    image = tissue.disc(round(2 * radius * TISSUE_TEXELS_PER_MM), seed)
    alpha = np.where(image.any(axis=2), 255, 0).astype(np.uint8)
    bgra = np.dstack([image[..., ::-1], alpha])
    data = base64.b64encode(cv2.imencode(".png", bgra)[1].tobytes()).decode()
    return (
        f'<image x="{x - radius:g}" y="{y - radius:g}" width="{2 * radius:g}" '
        f'height="{2 * radius:g}" href="data:image/png;base64,{data}"/>\n'
    )


def _colour(rgb: tuple[int, int, int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*rgb)


def _check(path: Path, ending: str) -> None:
    if path.suffix.lower() != ending:
        raise ConfigError(f"{path} should end in {ending}; give such a file with --out")


def _write(path: Path, text: str) -> None:
    """Write a file, whole or not at all."""
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}; give another --out") from None
