"""Detects the ArUco markers of one board in a grey picture, and those that are seen in a mirror.

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

    In a mirrored picture left and right would be exchanged without a word. The dictionary is
    therefore extended by the mirror images of its markers. A marker whose mirror image is a marker
    too cannot tell, and is not used.

    Args:
        board: geometry of the board.
    """

    def __init__(self, board: BoardGeometry) -> None:
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.relativeCornerRefinmentWinSize = 0.8  # the default of 0.3 doubles the error
        # Two window sizes instead of three: a third of the time, and as many markers.
        parameters.adaptiveThreshWinSizeMin, parameters.adaptiveThreshWinSizeMax = 5, 15
        plain = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
        self._count = len(plain.bytesList)  # marker n has the id n + count in a mirror
        mirrored = [_mirrored(plain, n) for n in range(self._count)]
        rate = parameters.errorCorrectionRate
        same = {n for n, bits in enumerate(mirrored) if plain.identify(bits, rate)[0]}
        self._known = {marker for marker, *_ in board.markers} - same
        images = [cv2.aruco.Dictionary.getByteListFromBits(bits) for bits in mirrored]
        both = np.concatenate([plain.bytesList, *images])
        dictionary = cv2.aruco.Dictionary(both, plain.markerSize, plain.maxCorrectionBits)
        self._detector = cv2.aruco.ArucoDetector(dictionary, parameters)

    def __call__(self, grey: Image) -> list[Marker]:
        """List the markers found; ids that are found twice are left out as ambiguous."""
        return self.look(grey)[0]

    def look(self, grey: Image) -> tuple[list[Marker], int]:
        """Return the markers found, as above, and the number of markers seen in a mirror."""
        found, ids, _ = self._detector.detectMarkers(grey)
        numbers = [] if ids is None else [int(i) for i in ids.ravel()]
        markers = [
            (np.asarray(corners, np.float64).reshape(4, 2), i)
            for corners, i in zip(found, numbers, strict=True)
            if i in self._known and numbers.count(i) == 1
        ]
        return markers, sum(i - self._count in self._known for i in numbers)


def _mirrored(dictionary: cv2.aruco.Dictionary, marker: int) -> Image:
    """Return the squares of a marker, 0 or 1, as they are seen in a mirror."""
    of_one, side = dictionary.bytesList[marker : marker + 1], dictionary.markerSize
    bits = cv2.aruco.Dictionary.getBitsFromByteList(of_one, side)
    return np.ascontiguousarray(bits[:, ::-1], np.uint8)
