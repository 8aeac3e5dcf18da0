"""Detects the ArUco markers of one board in a grey picture.

Reference:
    S. Garrido-Jurado et al., Pattern Recognition 47(6), 2014.
"""

from __future__ import annotations

import cv2
import numpy as np

from endolock.hw.api import BoardGeometry, Image, Vector

Marker = tuple[Vector, int]
"""Corners (4x2 [px]) and id."""


class MarkerDetector:
    """Detects the markers of one board.

    Args:
        board: geometry of the board.
    """

    def __init__(self, board: BoardGeometry) -> None:
        self._known = {marker for marker, *_ in board.markers}
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.relativeCornerRefinmentWinSize = 0.8  # the default of 0.3 doubles the error
        # Two window sizes instead of three: a third of the time, and as many markers.
        parameters.adaptiveThreshWinSizeMin, parameters.adaptiveThreshWinSizeMax = 5, 15
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
        self._detector = cv2.aruco.ArucoDetector(dictionary, parameters)

    def __call__(self, grey: Image) -> list[Marker]:
        """List the markers found; ids that are found twice are left out as ambiguous."""
        found, ids, _ = self._detector.detectMarkers(grey)
        numbers = [] if ids is None else [int(i) for i in ids.ravel()]
        return [
            (np.asarray(corners, np.float64).reshape(4, 2), i)
            for corners, i in zip(found, numbers, strict=True)
            if i in self._known and numbers.count(i) == 1
        ]
