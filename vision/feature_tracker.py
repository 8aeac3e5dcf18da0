"""Follows a selected target without markers: Lucas-Kanade, anchored to the reference.

Every frame is compared with the first, not with the previous one, so nothing drifts. A coarse
correlation near the predicted position gives the initial guess; points of the reference, turned
and scaled as last seen, are followed by Lucas-Kanade into the frame, and an affine map is fitted to
them. A frame that fails a gate is refused, with the reason: a wrong lock is worse than none.

Reference:
    B. Lucas and T. Kanade, IJCAI 1981; Z. Kalal et al., ICPR 2010 (forward-backward error).
"""

from __future__ import annotations

from cmath import isfinite
from typing import NamedTuple

import cv2
import numpy as np

from endolock.hw.api import Image
from endolock.vision.reference import Affine, Points, Reference, View, select, view, whole
from endolock.vision.triple_check import TripleCheck

REACH_PX = 72
"""Largest distance from the predicted position at which a target is searched [px]."""
EDGE = 16
"""Margin kept around a window in which points are followed [px]."""
BACKWARD_PX = 0.7
"""Largest forward-backward distance of an inlier [px]."""
FIT_PX = 1.5
"""Largest distance of an inlier from the fitted map [px]."""
MIN_INLIERS = 0.5
"""Gate: least share of inliers."""
MIN_LIKENESS = 0.75
"""Gate: least correlation with the original reference."""
AGAIN_LIKENESS = 0.80
"""Gate: least correlation with the reference after a search of the whole picture."""
SCALES = (0.35, 2.8)
"""Gate: smallest and largest size relative to the reference."""
MAX_STRETCH = 0.5
"""Gate: largest stretch over size; a board tilted by 70 deg."""
MIN_FOLLOWED = 6
"""Fewest points of a fit; fewer fit by chance."""
SCALE_STEP = 1.15
"""Gate: largest change of size, or rotation [rad] + 1, from frame to frame."""
JUMP_PX = 45.0
"""Gate: largest distance from the predicted position while tracking [px]: 1100 px/s at 25 Hz."""
SEARCH_SCALES = (1.0, 0.84, 1.19, 0.71, 1.41)
"""Sizes relative to the last one at which a lost target is searched."""
SEARCH_SIDE = 14.0
"""Side to which the window is reduced for the search [px]: enough detail to distinguish positions,
and a twentieth of the time."""
CANDIDATES = 3
"""Number of best positions of a search that are examined closely."""
NOISE_PX = 0.02
"""Least standard deviation of the position [px]. Source: measured on clean pictures."""
OVERLAP = 4.0
"""Number of points that count as one, because neighbours share most of their windows. Assumed."""

_UNTIL = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01)


class FollowedTarget(NamedTuple):
    """An accepted position of the target."""

    pixel: tuple[float, float]
    """(u, v) [px]."""
    covariance: tuple[float, float, float]
    """(uu, uv, vv) [px2]."""
    scale: float
    """Size relative to the reference [1]."""
    likeness: float
    """Correlation with the reference [1]."""


class FeatureTracker:
    """Follows one window of the first picture.

    Args:
        grey: the first picture.
        centre: centre of the window, (u, v) [px].
        half: half width and height of the window [px].

    Raises:
        ValueError: the window cannot be followed, with the reason.
    """

    def __init__(self, grey: Image, centre: tuple[float, float], half: tuple[int, int]) -> None:
        reference = select(grey, complex(*centre), half)
        if isinstance(reference, str):
            raise ValueError(reference)
        self.reference: Reference = reference
        self._last = Affine(complex(*centre))
        self._motion = 0.0j
        self._missed = 0
        self._check = TripleCheck(reference.offsets)
        self._check.accept(grey, self._last)

    def step(self, grey: Image) -> FollowedTarget | str:
        """Find the target in the next picture.

        Returns:
            Its position, or the reason of the gate that refused it.
        """
        predicted = self._last._replace(position=self._last.position + self._motion)
        found = self._near(grey, predicted)
        why = found if isinstance(found, str) else self._continuous(found[0], predicted)
        if not why and not isinstance(found, str):
            why = self._check.refusal(grey, found[0])
        if why:
            self._check.skip()
            again = self._search(whole(grey)) if self._missed else why
            if isinstance(again, str):
                return self._miss(why)
            found = again
        assert not isinstance(found, str)
        seen, track = found
        steady = self._missed == 0
        self._motion = 0.7 * (seen.position - self._last.position) if steady else 0.0j
        self._last, self._missed = seen, 0
        self._check.accept(grey, seen)
        return track

    def _miss(self, why: str) -> str:
        self._missed += 1
        self._motion *= 0.5
        return why

    def _near(self, grey: Image, guess: Affine) -> tuple[Affine, FollowedTarget] | str:
        """Search around a guess: coarse correlation, then points."""
        hx, hy = self._extent(guess.scale, 0)
        middle = _whole(guess.position)
        reach = REACH_PX + EDGE
        around = view(grey, middle, (hx + reach, hy + reach))
        area = around.crop(middle, (hx + REACH_PX, hy + REACH_PX))
        own = self.reference.warped(guess, (hx, hy))
        score = cv2.matchTemplate(_shrunk(area, 0.5), _shrunk(own, 0.5), cv2.TM_CCOEFF_NORMED)
        v, u = np.indices(score.shape) * 2.0 - REACH_PX
        _, _, _, (column, row) = cv2.minMaxLoc(score - 0.1 * (u * u + v * v) / REACH_PX**2)
        shift = complex(2 * column - REACH_PX, 2 * row - REACH_PX)
        return self._fine(around, guess._replace(position=middle + shift))

    def _extent(self, scale: float, margin: int) -> tuple[int, int]:
        """Return the half size of the window as now seen, plus a margin [px]."""
        hx, hy = self.reference.half
        return max(6, round(hx * scale)) + margin, max(6, round(hy * scale)) + margin

    def _fine(self, around: View, guess: Affine) -> tuple[Affine, FollowedTarget] | str:
        """Follow the points from the reference into the picture and back; fit; apply the gates."""
        half = self._extent(guess.scale, EDGE)
        middle = _whole(guess.position)
        own = self.reference.warped(guess, half)
        now = around.crop(middle, half)
        start = guess.moves(self.reference.offsets) + complex(*half)
        aim = start + guess.position - middle
        ahead, ok = _follow(own, now, start, aim)
        back, ok_back = _follow(now, own, ahead, start)
        good = ok & ok_back & (np.abs(back - start) < BACKWARD_PX)
        ahead += middle - complex(*half)
        good &= around.contains(ahead)
        fitted = _fit(self.reference.offsets, ahead, good)
        if fitted is None:
            return "too few points followed"
        seen, inliers, variance = fitted
        share = inliers / len(ahead)
        if share < MIN_INLIERS:
            return f"{100 * share:.0f} % of the points followed, {100 * MIN_INLIERS:.0f} % needed"
        if not SCALES[0] <= seen.scale <= SCALES[1]:
            return f"size {seen.scale:.2f} of the reference"
        if abs(seen.stretch) > MAX_STRETCH * seen.scale:
            return f"stretched by {abs(seen.stretch) / seen.scale:.2f}"
        likeness = self.reference.likeness(around, seen)
        if likeness < MIN_LIKENESS:
            return f"likeness {likeness:.2f}, {MIN_LIKENESS:.2f} needed"
        spread = max(variance * OVERLAP / inliers, NOISE_PX**2)
        pixel = seen.position.real, seen.position.imag
        return seen, FollowedTarget(pixel, (spread, 0.0, spread), seen.scale, likeness)

    def _continuous(self, seen: Affine, predicted: Affine) -> str:
        """Apply the gates on the change since the last frame, wider after missed frames."""
        change = seen.turn / self._last.turn
        frames = 1 + self._missed
        if max(abs(change), 1 / abs(change)) > SCALE_STEP**frames:
            return f"size changed by {abs(change):.2f}"
        jump = abs(seen.position - predicted.position)
        if jump > JUMP_PX * frames:
            return f"jump of {jump:.0f} px"
        return ""

    def _search(self, everywhere: View) -> tuple[Affine, FollowedTarget] | str:
        """Search the whole picture at several sizes, and examine the best positions closely."""
        side = 2 * min(self.reference.half) * self._last.scale
        shrink = min(1.0, SEARCH_SIDE / side)
        small = cv2.resize(
            everywhere.picture, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA
        )
        positions: list[tuple[float, Affine]] = []
        for scale in SEARCH_SCALES:
            size = self._last.resized(scale)
            own = self.reference.warped(size, self._extent(size.scale, 0))
            pattern = _shrunk(own, shrink)
            score = cv2.matchTemplate(small, pattern, cv2.TM_CCOEFF_NORMED)
            rows, columns = pattern.shape
            for _ in range(2):
                _, best, _, (u, v) = cv2.minMaxLoc(score)
                position = complex(u + columns / 2, v + rows / 2) / shrink - (0.5 + 0.5j)
                positions.append((best, size._replace(position=position)))
                cv2.circle(score, (u, v), rows // 2, -1.0, cv2.FILLED)
        positions.sort(key=lambda entry: -entry[0])
        for _, guess in positions[:CANDIDATES]:
            found = self._fine(everywhere, guess)
            if not isinstance(found, str):
                found = self._fine(everywhere, found[0])  # again, from the right position
            if not isinstance(found, str) and found[1].likeness >= AGAIN_LIKENESS:
                return found
        return "not found in the whole picture"


def _whole(position: complex) -> complex:
    return complex(round(position.real), round(position.imag))


def _shrunk(picture: Image, factor: float) -> np.ndarray:
    return cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)


def _follow(
    before: Image, after: Image, points: Points, guess: Points
) -> tuple[Points, np.ndarray]:
    """Follow complex points from one picture into another by Lucas-Kanade."""
    start, aim = (np.column_stack([p.real, p.imag]).astype(np.float32) for p in (points, guess))
    moved, ok, _ = cv2.calcOpticalFlowPyrLK(
        before,
        after,
        start,
        aim.copy(),
        winSize=(25, 25),
        maxLevel=1,
        criteria=_UNTIL,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    ends: Points = moved.astype(np.float64) @ np.array([1, 1j])
    return ends, ok.ravel() > 0


def _fit(offsets: Points, seen: Points, good: np.ndarray) -> tuple[Affine, int, float] | None:
    """Fit an affine map to the good points without outliers.

    Returns:
        The map, the number of inliers and their variance per coordinate [px2].
    """
    # p = position + turn d + stretch conj(d) is linear in real numbers, and so is its conjugate.
    for _ in range(4):
        count = int(good.sum())
        if count < MIN_FOLLOWED:
            return None
        d = offsets[good]
        ones = np.ones(count)
        columns = np.column_stack([ones, d.real, d.imag])
        solved, _, rank, _ = np.linalg.lstsq(columns, seen[good], rcond=1e-6)
        if rank < 3:
            return None
        position, x, y = (complex(c) for c in solved)
        affine = Affine(position, (x - 1j * y) / 2, (x + 1j * y) / 2)
        if not isfinite(position) or not affine.turn:
            return None
        off = np.abs(seen - position - affine.moves(offsets))
        limit = max(FIT_PX, 2.5 * float(np.median(off[good])))
        kept = good & (off < limit)
        if limit == FIT_PX and kept.sum() == count:
            break
        good = kept
    squared = float((off[good] ** 2).sum())
    count = int(good.sum())
    return affine, count, squared / max(2 * count - 6, 1)
