"""Draws the prints of the boards of `hw/boards.py`."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from endolock.hw.api import Image
from endolock.hw.boards import PrintedBoard
from endolock.twin.model import tissue

CENTRE_M = 0.044
"""Side of the middle square with the finer texture [m]."""
TEXELS_PER_MM = 6
CENTRE_TEXELS_PER_MM = 24
"""Resolutions at which the modules of the markers, six to a side, are whole texels. One pixel
covers 2.7 texels at 12 cm and 1.4 at 1.5 cm with f = 262 px; markers are found best at 1-3."""
PAPER = (236, 232, 222)
INK = (26, 24, 28)
RED = (178, 34, 48)


def picture(board: PrintedBoard, side_m: float, texels_per_mm: int) -> Image:
    """Draw the middle of a board as printed, RGB.

    Args:
        board: the board; its marker modules must be whole texels at this resolution.
        side_m: side of the square to draw, around the board's centre [m].
        texels_per_mm: resolution [1/mm].
    """
    scale = texels_per_mm * 1000.0
    n = round(side_m * scale)
    image = np.full((n, n, 3), PAPER, np.uint8)
    for seed, patch in enumerate(board.patches):
        centre = (np.array([patch.x, patch.y]) + side_m / 2) * scale - 0.5
        DRAWN[patch.kind](image, centre, patch.radius * scale, seed)
    geometry = board.geometry
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, geometry.dictionary))
    for marker, x, y, size in geometry.markers:
        if max(abs(x), abs(y)) + size / 2 > side_m / 2:
            continue
        side = round(size * scale)
        u, v = (round((c - size / 2 + side_m / 2) * scale) for c in (x, y))
        bits = cv2.aruco.generateImageMarker(dictionary, marker, side)
        image[v : v + side, u : u + side] = np.where(bits[..., None] > 0, PAPER, INK)
    return image


def decoy() -> Image:
    """Draw a round target on paper that resembles that of the board in other widths and colours.

    The paper is 30 mm wide, the radius of the target 3.5 mm.
    """
    n = 30 * CENTRE_TEXELS_PER_MM // 2
    image = np.full((n, n, 3), PAPER, np.uint8)
    centre = np.array([n - 1, n - 1]) / 2
    radius = 3.5 * CENTRE_TEXELS_PER_MM / 2
    for share, colour in ((1.0, RED), (0.6, PAPER), (0.42, INK)):
        _disc(image, centre, share * radius, colour)
    return image


def rings(radius: float) -> tuple[tuple[float, tuple[int, int, int]], ...]:
    """Return the discs of the round target, largest first: radius and colour."""
    shares = ((1.0, INK), (0.87, PAPER), (0.73, RED), (0.27, PAPER), (0.1, INK))
    return tuple((radius * share, colour) for share, colour in shares)


def _draw_rings(image: Image, centre: np.ndarray, radius: float, _seed: int) -> None:
    for size, colour in rings(radius):
        _disc(image, centre, size, colour)


def _disc(image: Image, centre: np.ndarray, radius: float, colour: tuple[int, int, int]) -> None:
    """Fill a circle, whose centre may lie between texels."""
    fixed_point = tuple(int(v) for v in np.rint(centre * 16))
    cv2.circle(image, fixed_point, round(radius * 16), colour, cv2.FILLED, cv2.LINE_AA, shift=4)


def _draw_tissue(image: Image, centre: np.ndarray, radius: float, seed: int) -> None:
    side = 2 * round(radius)
    disc = tissue.disc(side, seed)
    u, v = np.rint(centre + 0.5 - side / 2).astype(int)
    area = image[v : v + side, u : u + side]
    area[...] = np.where(disc.any(axis=2, keepdims=True), disc, area)


DRAWN: dict[str, Callable[[Image, np.ndarray, float, int], None]] = {
    "rings": _draw_rings,
    "tissue": _draw_tissue,
}
