"""The printed boards: positions of their nested markers and of their targets.

Markers of 20, 8 and 2.5 mm cover distances from 16 cm down to 1 cm: a side of 18 px is always
detected, and with f = 262 px they have that up to 29, 11 and 3.6 cm. The small ones are in the
middle, which is all that is visible at close range.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from endolock.hw.api import BoardGeometry

DICTIONARY = "DICT_4X4_50"
INSTEAD = {8: 20, 9: 21, 17: 22}
"""Ids replaced by others: the markers 8, 9, 17 and 47 of this dictionary equal their mirror images,
so that a mirrored picture would be believed."""
SIZE_M = 0.100


class Patch(NamedTuple):
    """A target on a board."""

    kind: str
    """rings, a printed round target, or tissue."""
    x: float
    y: float
    radius: float
    """[m]"""


class PrintedBoard(NamedTuple):
    """Markers and targets of one board."""

    geometry: BoardGeometry
    patches: tuple[Patch, ...]

    def aimed_at(self, number: int) -> BoardGeometry:
        """Return the geometry with one of the patches as the target."""
        patch = self.patches[number]
        return replace(self.geometry, target=(patch.x, patch.y))


def _square(half: float) -> list[tuple[float, float]]:
    """Corners of a square, top left first, clockwise."""
    return [(-half, -half), (half, -half), (half, half), (-half, half)]


def _ring(half: float) -> list[tuple[float, float]]:
    """Corners of a square and the middles of its sides."""
    return [*_square(half), (0, -half), (half, 0), (0, half), (-half, 0)]


def _print(
    patches: tuple[Patch, ...], rows: list[tuple[float, list[tuple[float, float]]]]
) -> PrintedBoard:
    """Make a board with numbered markers of these sizes at these points."""
    squares = [(x, y, size) for size, row in rows for x, y in row]
    markers = tuple((INSTEAD.get(n, n), x, y, size) for n, (x, y, size) in enumerate(squares))
    target = patches[0].x, patches[0].y
    geometry = BoardGeometry(dictionary=DICTIONARY, markers=markers, size_m=SIZE_M, target=target)
    return PrintedBoard(geometry, patches)


def standard() -> BoardGeometry:
    """Return the geometry of the board that scenarios use unless they say otherwise."""
    return all_boards()["rings"].geometry


def all_boards() -> dict[str, PrintedBoard]:
    """Return all boards by name; the first patch of each is its target."""
    corners = (0.020, _square(0.036))
    ring = (0.008, _ring(0.013))
    dots = (0.0025, _ring(0.0055))
    middles = (0.008, [(0.0, -0.036), (0.036, 0.0), (0.0, 0.036), (-0.036, 0.0)])
    several = (
        Patch("rings", -0.011, -0.011, 0.007),
        Patch("tissue", 0.011, -0.011, 0.008),
        Patch("tissue", -0.011, 0.011, 0.008),
        Patch("rings", 0.011, 0.011, 0.0035),
    )
    between = (0.0025, [(0.0, y / 1e3) for y in (-18, -11, -4, 4, 11, 18)])
    return {
        "rings": _print((Patch("rings", 0.0, 0.0, 0.0035),), [corners, ring, dots]),
        "tissue": _print((Patch("tissue", 0.0, 0.0, 0.020),), [corners, middles]),
        "several": _print(several, [corners, middles, between]),
    }


def aimed(kind: str, number: int) -> BoardGeometry:
    """Return the geometry of a board by name, with one of its patches as the target."""
    return all_boards()[kind].aimed_at(number)
