"""The printed boards as SVG, in mm: the same markers, discs and tissue as in the twin."""

from __future__ import annotations

import base64

import cv2
import numpy as np

from endolock.hw.api import Image
from endolock.hw.boards import Patch, PrintedBoard
from endolock.twin.model import drawing

MODULES = 6
"""Modules along a marker's side, with the black border."""
MARGIN_MM = 10.0
RULER_MM = 50.0


def sheet(board: PrintedBoard) -> str:
    """Draw a board as an SVG in true size, with a cutting line and a ruler below.

    Args:
        board: the board to draw.

    Returns:
        The SVG. Its unit is mm, and its origin the centre of the board.
    """
    side = board.geometry.size_m * 1e3
    low, width, height = -side / 2 - MARGIN_MM, side + 2 * MARGIN_MM, side + 3 * MARGIN_MM
    y = side / 2 + MARGIN_MM
    ends = " ".join(f"M{x:g} {y - 2:g}v4" for x in (-RULER_MM / 2, RULER_MM / 2))
    return f"""<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}mm" height="{height:g}mm" \
viewBox="{low:g} {low:g} {width:g} {height:g}">
{elements(board)}
<rect id="cut" x="{-side / 2:g}" y="{-side / 2:g}" width="{side:g}" height="{side:g}" \
fill="none" stroke="#808080" stroke-width="0.1"/>
<path id="ruler" d="M{-RULER_MM / 2:g} {y:g}h{RULER_MM:g} {ends}" fill="none" stroke="black" \
stroke-width="0.2"/>
<text x="0" y="{y + 6:g}" font-family="sans-serif" font-size="4" text-anchor="middle">\
print at 100 %; this line is {RULER_MM:g} mm</text>
</svg>
"""


def elements(board: PrintedBoard) -> str:
    """Draw the contents of a board as SVG elements [mm], origin at its centre, x right, y down."""
    geometry = board.geometry
    half = geometry.size_m * 500
    parts = [_rect(-half, -half, 2 * half, 2 * half, drawing.PAPER)]
    tissue = [patch for patch in board.patches if patch.kind == "tissue"]
    if tissue:
        texels = drawing.picture(board, drawing.CENTRE_M, drawing.CENTRE_TEXELS_PER_MM)
        parts += [_tissue(patch, n, texels) for n, patch in enumerate(tissue)]
    for patch in board.patches:
        if patch.kind == "rings":
            parts += [
                f'<circle cx="{_mm(patch.x)}" cy="{_mm(patch.y)}" r="{_mm(radius)}" '
                f'fill="{_hex(colour)}"/>'
                for radius, colour in drawing.rings(patch.radius)
            ]
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, geometry.dictionary))
    for marker, x, y, size in geometry.markers:
        bits = cv2.aruco.generateImageMarker(dictionary, marker, MODULES) > 0
        parts.append(f'<g id="marker-{marker}">{_marker(bits, x * 1e3, y * 1e3, size * 1e3)}</g>')
    return "\n".join(parts)


def _marker(bits: np.ndarray, x: float, y: float, size: float) -> str:
    """Draw a marker: a square of ink with rectangles of paper on it.

    Runs of paper in every row and in every column are drawn as one rectangle, which leaves no
    visible seam.
    """
    left, top, step = x - size / 2, y - size / 2, size / MODULES
    parts = [_rect(left, top, size, size, drawing.INK)]
    for n in range(MODULES):
        for start, count in _spans(bits[n]):
            u, v = left + start * step, top + n * step
            parts.append(_rect(u, v, count * step, step, drawing.PAPER))
        for start, count in _spans(bits[:, n]):
            u, v = left + n * step, top + start * step
            parts.append(_rect(u, v, step, count * step, drawing.PAPER))
    return "".join(parts)


def _spans(row: np.ndarray) -> list[tuple[int, int]]:
    """Return the runs of paper in a row: first module and count."""
    edges = np.flatnonzero(np.diff(row.astype(int), prepend=0, append=0)).tolist()
    return [(a, b - a) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _tissue(patch: Patch, number: int, texels: Image) -> str:
    """Draw a patch of tissue, cut out of the same picture as in the twin."""
    scale = drawing.CENTRE_TEXELS_PER_MM * 1e3
    side = 2 * round(patch.radius * scale)
    left, top = (round((c + drawing.CENTRE_M / 2) * scale - side / 2) for c in (patch.x, patch.y))
    crop = cv2.cvtColor(texels[top : top + side, left : left + side], cv2.COLOR_RGB2BGR)
    code = base64.b64encode(cv2.imencode(".png", crop)[1].tobytes()).decode("ascii")
    x, y, r = _mm(patch.x), _mm(patch.y), _mm(patch.radius)
    return (
        f'<clipPath id="disc-{number}"><circle cx="{x}" cy="{y}" r="{r}"/></clipPath>'
        f'<image x="{_mm(patch.x - patch.radius)}" y="{_mm(patch.y - patch.radius)}" '
        f'width="{_mm(2 * patch.radius)}" height="{_mm(2 * patch.radius)}" '
        f'clip-path="url(#disc-{number})" href="data:image/png;base64,{code}"/>'
    )


def _rect(x: float, y: float, width: float, height: float, colour: tuple[int, int, int]) -> str:
    numbers = (f"{round(v, 5):g}" for v in (x, y, width, height))
    return '<rect x="{}" y="{}" width="{}" height="{}" fill="{}"/>'.format(*numbers, _hex(colour))


def _mm(metres: float) -> str:
    return f"{round(metres * 1e3, 5):g}"


def _hex(colour: tuple[int, int, int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
