"""The reference of the feature tracker: a patch of the first picture, and how to compare it.

Pictures are compared after local contrast normalisation, (I - mean)/(deviation + floor) over a box
around each pixel, which removes gain, fall-off of the light and shadows.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from endolock.hw.api import Image

BOX = 31
"""Side of the box over which contrast is normalised [px]. Assumed."""
FLOOR = 6.0
"""Added to the deviation [grey levels]: noise in flat parts must not become texture. Assumed."""
CONTRAST = 48.0
"""Grey levels of one deviation in the normalised picture."""
MARGIN = 14
"""Margin kept around the selected window [px], for the windows of its outermost points."""
POINTS = 40
"""Largest number of points to follow."""
MIN_POINTS = 8
"""Fewest corners in a window; with fewer it has too little texture to follow. Assumed."""
QUALITY = 0.02
"""Least strength of a corner, relative to the strongest. Assumed."""
MIN_STRENGTH = 2e-3
"""Least strength of the strongest corner, after normalisation: the smaller eigenvalue of the
gradients' covariance. Assumed; noise alone stays below, printed rings reach 100 times it."""


Points = NDArray[np.complex128]
"""Positions or offsets u + iv [px]."""


class Affine(NamedTuple):
    """The reference as seen: offset d from its centre at position + turn d + stretch conj(d)."""

    position: complex
    """Pixel u + iv of the centre."""
    turn: complex = 1.0 + 0.0j
    """Scale times rotation, clockwise in the picture."""
    stretch: complex = 0.0j
    """Deviation from a similarity: seen at an angle, a square becomes a parallelogram."""

    @property
    def scale(self) -> float:
        """Size relative to the reference [1]."""
        return abs(self.turn)

    def moves(self, offsets: Points) -> Points:
        """Return offsets of the reference as seen in the picture, relative to `position`."""
        seen: Points = self.turn * offsets + self.stretch * offsets.conj()
        return seen

    def resized(self, factor: float) -> Affine:
        """Return the same map at another size."""
        return Affine(self.position, factor * self.turn, factor * self.stretch)

    def matrix(self, source: complex, position: complex) -> np.ndarray:
        """Return the 2x3 matrix of this map for `cv2.warpAffine`, `source` to `position`."""
        x, y = self.turn + self.stretch, 1j * (self.turn - self.stretch)
        shift = position - x * source.real - y * source.imag
        return np.array([[x.real, y.real, shift.real], [x.imag, y.imag, shift.imag]])


class View(NamedTuple):
    """A normalised part of a picture."""

    picture: Image
    origin: complex
    """Position of its first pixel in the whole picture, u + iv [px]."""
    size: tuple[int, int]
    """Width and height of the whole picture [px]."""

    def contains(self, positions: Points) -> np.ndarray:
        """Return which positions are within the whole picture."""
        width, height = self.size
        u, v = positions.real, positions.imag
        return np.asarray((u > 0) & (v > 0) & (u < width - 1) & (v < height - 1))

    def crop(self, middle: complex, half: tuple[int, int]) -> Image:
        """Cut out a window around a position in whole pixels of the whole picture."""
        local = middle - self.origin
        return crop(self.picture, (int(local.real), int(local.imag)), half)


def view(grey: Image, middle: complex, half: tuple[int, int]) -> View:
    """Normalise a window of a picture.

    Args:
        grey: the whole picture.
        middle: middle of the window, whole pixels [px].
        half: half width and height of the window [px].
    """
    u, v = int(middle.real), int(middle.imag)
    edge = BOX // 2
    area = normalised(crop(grey, (u, v), (half[0] + edge, half[1] + edge)))
    height, width = grey.shape
    inner = np.ascontiguousarray(area[edge:-edge, edge:-edge])
    return View(inner, middle - complex(*half), (width, height))


def whole(grey: Image) -> View:
    """Normalise a whole picture."""
    height, width = grey.shape
    return View(normalised(grey), 0j, (width, height))


class Reference(NamedTuple):
    """A selected window of a normalised picture."""

    patch: Image
    """The window with `MARGIN` around it, normalised."""
    centre: complex
    """The selected centre in the patch [px]."""
    half: tuple[int, int]
    """Half width and height of the window [px]."""
    offsets: Points
    """Points to follow, as complex offsets from the centre [px]."""

    def warped(self, seen: Affine, half: tuple[int, int]) -> Image:
        """Warp the patch as seen, its centre in the middle of a picture of 2 half + 1 pixels."""
        size = 2 * half[0] + 1, 2 * half[1] + 1
        matrix = seen.matrix(self.centre, complex(*half))
        drawn = cv2.warpAffine(self.patch, matrix, size, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(drawn, np.uint8)

    def likeness(self, around: View, seen: Affine) -> float:
        """Return the correlation of the window with the picture where it is seen."""
        size = 2 * self.half[0] + 1, 2 * self.half[1] + 1
        matrix = seen.matrix(complex(*self.half), seen.position - around.origin)
        back = cv2.warpAffine(
            around.picture,
            matrix,
            size,
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        own = self.warped(Affine(0j), self.half)
        return float(cv2.matchTemplate(back, own, cv2.TM_CCOEFF_NORMED)[0, 0])


def normalised(grey: np.ndarray) -> Image:
    """Normalise the local contrast of a grey picture."""
    values = grey.astype(np.float32)
    mean = cv2.blur(values, (BOX, BOX))
    squared = cv2.sqrBoxFilter(values, cv2.CV_32F, (BOX, BOX))
    spread = np.sqrt(np.maximum(squared - mean * mean, 0))
    contrast = cv2.divide(values - mean, spread + FLOOR, scale=CONTRAST)
    return np.asarray(cv2.addWeighted(contrast, 1, contrast, 0, 128, dtype=cv2.CV_8U), np.uint8)


def select(grey: Image, centre: complex, half: tuple[int, int]) -> Reference | str:
    """Make a reference from a window of a picture.

    Args:
        grey: the picture.
        centre: centre of the window, u + iv [px].
        half: half width and height of the window [px].

    Returns:
        The reference, or the reason why the window cannot be followed.
    """
    height, width = grey.shape
    (hx, hy), u, v = half, round(centre.real), round(centre.imag)
    if u - hx < 0 or v - hy < 0 or u + hx >= width or v + hy >= height:
        return "selection reaches beyond the picture"
    patch = view(grey, complex(u, v), (hx + MARGIN, hy + MARGIN)).picture
    local = centre - complex(u, v) + complex(hx + MARGIN, hy + MARGIN)
    mask = np.zeros(patch.shape, np.uint8)
    mask[MARGIN:-MARGIN, MARGIN:-MARGIN] = 255
    strength = cv2.cornerMinEigenVal(patch, 5)[mask > 0].max()
    spacing = max(3.0, (hx * hy) ** 0.5 / 5)
    found = cv2.goodFeaturesToTrack(patch, POINTS, QUALITY, spacing, mask=mask, blockSize=5)
    if strength < MIN_STRENGTH or found is None or len(found) < MIN_POINTS:
        return "selection has too little texture"
    points: Points = found.reshape(-1, 2) @ np.array([1, 1j])
    return Reference(patch, local, half, points - local)


def crop(picture: Image, middle: tuple[int, int], half: tuple[int, int]) -> Image:
    """Cut out a window of 2 half + 1 pixels; beyond the picture its border is repeated."""
    (u, v), (hx, hy), (height, width) = middle, half, picture.shape
    left, top, right, bottom = u - hx, v - hy, u + hx + 1, v + hy + 1
    inside = picture[max(0, top) : max(0, bottom), max(0, left) : max(0, right)]
    if inside.shape == (2 * hy + 1, 2 * hx + 1):
        return inside
    columns = np.clip(np.arange(left, right), 0, width - 1)
    rows = np.clip(np.arange(top, bottom), 0, height - 1)
    return picture[rows[:, None], columns]
