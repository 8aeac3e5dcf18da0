"""Finds the ArUco markers of one board in a grey picture.

Reference:
    S. Garrido-Jurado et al., Pattern Recognition 47(6), 2014.
"""

from __future__ import annotations

import cv2
import numpy as np

from endolock.hw.api import BoardGeometry, Image, Vector

Marker = tuple[Vector, int]
"""Corners (4x2 [px]) and id."""
NOISY = 5.0
"""Smooth a picture with more noise than this [grey levels]: at 20 it would take ten times as
long, for every speck is a candidate."""


class MarkerDetector:
    """Looks for the markers of one board.

    Args:
        board: what is printed on it.
    """

    def __init__(self, board: BoardGeometry) -> None:
        self._known = {marker for marker, *_ in board.markers}
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.relativeCornerRefinmentWinSize = 0.8  # 0.3 is the default: twice the error
        # Two window sizes instead of three: a third of the time, no marker less.
        parameters.adaptiveThreshWinSizeMin, parameters.adaptiveThreshWinSizeMax = 5, 15
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
        self._detector = cv2.aruco.ArucoDetector(dictionary, parameters)

    def __call__(self, grey: Image) -> list[Marker]:
        """List the markers seen, each number once: where it occurs twice, neither can be told."""
        found, ids, _ = self._detector.detectMarkers(grey)
        numbers = [] if ids is None else [int(i) for i in ids.ravel()]
        return [
            (np.asarray(corners, np.float64).reshape(4, 2), i)
            for corners, i in zip(found, numbers, strict=True)
            if i in self._known and numbers.count(i) == 1
        ]


def grey_of(image: Image) -> Image:
    """Return a colour picture in grey, smoothed where it is noisy."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    if _noise(grey) > NOISY:
        grey = cv2.GaussianBlur(grey, (3, 3), 0)
    return np.asarray(grey, np.uint8)


def _noise(grey: np.ndarray) -> float:
    """Standard deviation of the noise in a picture [grey levels], from some of its rows.

    The median of |second difference| is 0.6745 sqrt(6) times that of white noise; edges are few
    and do not move a median.
    """
    rows = grey[::24].astype(np.int16)
    return float(np.median(np.abs(rows[:, 2:] - 2 * rows[:, 1:-1] + rows[:, :-2]))) / 1.652
