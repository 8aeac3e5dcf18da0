"""The triple check of the thesis: motion over two frames must equal the sum of both single motions.

Points are followed from frame n-2 to n-1 and on to n, and from n-2 to n directly; if the results
differ, one of the matches was false. Source: recommendation of the thesis. It is necessary but not
sufficient: a textured occluder that moves slowly in front of the target is consistent too.
"""

from __future__ import annotations

import cv2
import numpy as np

from endolock.hw.api import Image
from endolock.vision.reference import Affine, Points, crop

LIMIT_PX = 1.0
"""Gate: largest median distance between both results [px]. Source: ROC in docs/vision.md."""
HALF = 28
"""Margin around the points of the target in which they are followed [px]."""
POINTS = 12

Kept = tuple[Image, complex, Points, Points | None]
"""A picture, the target's position in it, its points, and those followed from the last picture."""


class TripleCheck:
    """Keeps the last two pictures and the positions of points of the target in them.

    Args:
        offsets: points of the target, complex offsets from its centre in the reference [px].
    """

    def __init__(self, offsets: Points) -> None:
        self._offsets = offsets[:POINTS]
        self._before: Kept | None = None
        self._now: Kept | None = None
        self.distance_px = 0.0
        """Distance found by the last check [px]; 0 if there was none."""

    @property
    def ready(self) -> bool:
        """Whether the next picture can be checked, because the last two were accepted."""
        return self._now is not None and self._now[3] is not None

    def refusal(self, grey: Image, seen: Affine) -> str:
        """Return why the motion into a picture is refused; empty if consistent, or not testable.

        Args:
            grey: the new picture.
            seen: supposed appearance of the target in it.
        """
        self.distance_px = 0.0
        if self._before is None or self._now is None or self._now[3] is None:
            return ""
        moved = self._now[3]
        two = self._flow(self._before, grey, seen, self._before[2])
        one = self._flow(self._now, grey, seen, moved)
        apart = np.abs(one - two)
        self.distance_px = float(np.median(apart))
        if self.distance_px > LIMIT_PX:
            return f"triple check off by {self.distance_px:.1f} px"
        return ""

    def accept(self, grey: Image, seen: Affine) -> None:
        """Store a picture in which the target was found."""
        points = seen.position + seen.moves(self._offsets)
        self._before, now = self._now, (grey, seen.position, points, None)
        moved = self._flow(self._before, grey, seen, self._before[2]) if self._before else None
        self._now = (*now[:3], moved)

    def skip(self) -> None:
        """Forget both pictures: the target was not found, so the next two cannot be checked."""
        self._before = self._now = None

    def _flow(
        self,
        start: Kept,
        grey: Image,
        seen: Affine,
        points: Points,
    ) -> Points:
        """Follow points from an earlier picture into a new one."""
        picture, position, _, _ = start
        reach = int(np.abs(self._offsets).max() * max(1.0, seen.scale)) + HALF
        half = reach, reach
        first, last = (
            (round(where.real), round(where.imag)) for where in (position, seen.position)
        )
        own, other = crop(picture, first, half), crop(grey, last, half)
        shift = complex(*half)
        local = points - complex(*first) + shift
        pixels = np.column_stack([local.real, local.imag]).astype(np.float32)
        aims = pixels.copy()  # both windows are centred on the target
        moved, _, _ = cv2.calcOpticalFlowPyrLK(
            own,
            other,
            pixels,
            aims,
            winSize=(13, 13),
            maxLevel=1,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        ends: Points = moved.astype(np.float64) @ np.array([1, 1j]) + complex(*last) - shift
        return ends
