"""The printed target board: where its markers are, and the picture that is printed on it."""

from __future__ import annotations

import cv2
import numpy as np

from endolock.hw.api import BoardGeometry, Image

TEXELS_PER_MM = 5
"""Print resolution: 2.3 texels a pixel at 12 cm; markers are found best at 1-3."""
PAPER = (236, 232, 222)
INK = (26, 24, 28)
RINGS = ((15.0, INK), (13.0, PAPER), (11.0, (178, 34, 48)), (4.0, PAPER), (1.5, INK))
"""The target: discs from the largest to the smallest, radius [mm] and colour."""


def standard() -> BoardGeometry:
    """Return the board of all scenarios: four 24 mm markers around a 30 mm target.

    24 mm is 52 px at 12 cm and 39 px at 16 cm with f = 262 px; a side of 18 px is always detected.
    """
    return BoardGeometry(
        dictionary="DICT_4X4_50",
        markers=((0, -0.034, -0.034), (1, 0.034, -0.034), (2, 0.034, 0.034), (3, -0.034, 0.034)),
        marker_size_m=0.024,
        size_m=0.100,
    )


def picture(board: BoardGeometry) -> Image:
    """Draw the board as it is printed, RGB.

    Args:
        board: what to draw; marker sides must be whole modules at `TEXELS_PER_MM`.
    """
    scale = TEXELS_PER_MM * 1000.0
    n = round(board.size_m * scale)
    image = np.full((n, n, 3), PAPER, np.uint8)
    # A texel covers 1/scale; drawing with 4 fractional bits puts centres between texels.
    centre = (np.array(board.target) + board.size_m / 2) * scale - 0.5
    fixed_point = tuple(int(v) for v in np.rint(centre * 16))
    for radius_mm, colour in RINGS:
        radius = round(radius_mm * TEXELS_PER_MM * 16)
        cv2.circle(image, fixed_point, radius, colour, cv2.FILLED, cv2.LINE_AA, shift=4)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    side = round(board.marker_size_m * scale)
    for marker, x, y in board.markers:
        u, v = (round((c + board.size_m / 2) * scale) - side // 2 for c in (x, y))
        bits = cv2.aruco.generateImageMarker(dictionary, marker, side)
        image[v : v + side, u : u + side] = np.where(bits[..., None] > 0, PAPER, INK)
    return image
