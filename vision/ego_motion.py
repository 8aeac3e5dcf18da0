"""Rotation of the camera between two pictures, from the background.

Points are followed from one picture to the next. The camera sits at the end of a bending section,
which turns it about a point a lever L behind it: a rotation vector w of the camera moves it by
t = w x (0, 0, L), in its own axes. A point seen at the ray r = (x, y, 1) and at the depth 1/q is
then seen at

    r' ~ R(w)^T (r - q t)

In the middle of the picture that is a flow of (1 + L q) w: without its parallax, a wall at 22 cm
makes a rotation 24 % too large. The wall is taken as a plane, q = g . r with the inverse depth g_3
and its slopes g_1, g_2. w and g are fitted together, with g known from the earlier pictures: flow
by rotation grows towards the edges, flow by parallax does not, so every fast pair of pictures tells
L g. An error of L therefore changes g alone, and hardly w.

The covariance is s^2 (J^T J + prior)^-1, marginal over g, where s^2 is `SHARED` times the mean
square of the residuals, because points near each other share their errors; `UNMODELLED` adds to it.

Reference:
    B. D. Lucas and T. Kanade, IJCAI 1981 (following points); J. Shi and C. Tomasi, CVPR 1994.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from endolock.hw import rotation
from endolock.hw.api import Calibration, Frame, Image, Vector
from endolock.vision import camera_model, refusal
from endolock.vision.background import LEAST_SHARE, TOO_LITTLE, Background, Mask
from endolock.vision.grey import grey_of
from endolock.vision.observation import Turn

LEVER_M = 0.0525
"""Distance from the camera to the point about which it turns [m], half the bending length plus the
rigid tip: 75 mm / 2 + 15 mm. Assumed."""
INVERSE_DEPTH, INVERSE_DEPTH_STD = 4.0, 3.0
"""Inverse depth of the background before any is measured, and its standard deviation [1/m]; the
latter is that of the slopes too. Assumed: walls at 0.14 m and farther."""
WANDER = 0.04
"""Standard deviation of the change of inverse depth and slopes from picture to picture [1/m].
Assumed."""
NEAREST = 30.0
"""Largest inverse depth of a background [1/m]. Assumed."""
POINTS = 80
MIN_POINTS = 12
"""Fewest points; fewer may agree by chance. Assumed."""
COLUMNS = 320
"""Width of the reduced pictures in which points are followed, about [px]: a fifth of the time that
640 px take."""
SMOOTH_PX = 0.8
"""Standard deviation of the smoothing of reduced pictures [px], against the steps of their edges.
Assumed."""
SHADE_PX, GAIN = 21, 3.0
"""Side of the windows whose mean is taken away from reduced pictures [px], because shade and
vignette move with the camera; and the factor on what is left [1]."""
SPACING_PX = 10
WINDOW_PX = 15
"""Least distance of points, and side of the window that is followed, in reduced pictures [px]."""
OFFSETS_PX = np.array([[0.618034, 0.754878]]) * np.arange(POINTS)[:, None] % 1.0
"""Offsets of the points from the middles of pixels, evenly spread, in reduced pictures [px].
Interpolation smooths least in the middle of a pixel, so from there motions below 0.1 px come out
6 % too large, and from halfway between pixels 3 % too small. Source: measured."""
LEVELS = 3
"""Number of times that reduced pictures are halved for fast motions [1]."""
MISMATCH = 0.5
"""Largest mean difference of a followed window from the first, in standard deviations of the
window's grey levels [1]. Assumed."""
CONTRAST = 1.0
"""Least standard deviation of a window [grey levels]. Assumed."""
OUTLIER = 2.5
"""Largest residual of an inlier, in medians of the residuals."""
AGREE = 0.6
"""Least share of the followed points that must be inliers [1]. Assumed."""
NOISE_PX = 0.005
"""Least noise of a followed point, in reduced pictures [px]. Source: measured."""
WORST_PX = 1.0
"""Largest rms residual of the inliers, in reduced pictures [px]. Assumed: it is below 0.1 px on
rendered pictures."""
SHARED = 2.0
"""Ratio of the variance of a fit to that of a fit to independent points [1]. Source: measured."""
UNMODELLED = 0.004
"""Standard deviation of each part of a rotation that is due to its size [1]: walls are not flat,
and the point about which the camera turns moves. Source: measured."""
KEPT_S = 0.2
"""The earlier picture is kept for this time [s] where the next ones cannot be compared with it.
Assumed."""


class _View(NamedTuple):
    """A picture in which points can be followed."""

    t: float
    grey: Image
    open: Mask


class EgoMotion:
    """Measures the rotation from each usable frame to the next.

    Args:
        calibration: the camera's geometry.
        lever_m: see `LEVER_M`.
    """

    def __init__(self, calibration: Calibration, lever_m: float = LEVER_M) -> None:
        self._calibration = calibration
        self._factor = max(1, round(calibration.width / COLUMNS))
        self.background = Background(calibration)
        """Makes the masks."""
        self._lever = np.array([[0.0, lever_m, 0.0], [-lever_m, 0.0, 0.0], [0.0, 0.0, 0.0]])
        self._before: _View | None = None
        self._rate = np.zeros(3)
        self._plane = np.array([0.0, 0.0, INVERSE_DEPTH])
        self._spread = INVERSE_DEPTH_STD**2 * np.eye(3)

    def __call__(self, frame: Frame, mask: Mask | None = None) -> Turn | str:
        """Compare a frame with the last one that could be used.

        Args:
            frame: the newest frame.
            mask: where it shows background, made by `background`; everywhere if None.

        Returns:
            The rotation, or the reason why there is none.
        """
        why = refusal.reason(frame, self._calibration)
        if why or frame.image is None:
            return why
        mask = self.background.everything() if mask is None else mask
        if self.background.share(mask) < LEAST_SHARE:
            return TOO_LITTLE
        now = _View(frame.t_capture, self._reduced(frame.image), mask)
        before = self._before
        if before is None or now.t <= before.t:
            self._before = now
            return "no previous frame"
        turn = self._compare(before, now)
        if not isinstance(turn, str) or now.t - before.t > KEPT_S:
            self._before = now
        if isinstance(turn, str):
            self._rate = np.zeros(3)
        return turn

    def _compare(self, before: _View, now: _View) -> Turn | str:
        """Follow points from one picture to the other and fit the rotation."""
        passed = now.t - before.t
        expected = self._rate * passed if passed < KEPT_S else np.zeros(3)
        starts, ends = self._follow(before, now, expected)
        if len(starts) < MIN_POINTS:
            return f"{len(starts)} points of the background followed, {MIN_POINTS} needed"
        rays = camera_model.rays(self._calibration, starts)
        prior = np.linalg.inv(self._spread + WANDER**2 * np.eye(3))
        unknown = np.concatenate([expected, self._plane])
        kept, size = np.ones(len(rays), bool), np.zeros(len(rays))
        least = NOISE_PX * self._factor
        noise = 1.0
        for _ in range(2):
            off, slope = self._flow(rays, ends, unknown)
            for _ in range(2):
                weight = np.repeat(kept, 2) / noise
                information = slope.T @ (weight[:, None] * slope)
                information[3:, 3:] += prior
                slant = slope.T @ (weight * off)
                slant[3:] += prior @ (self._plane - unknown[3:])
                step = np.linalg.solve(information, slant)
                size = np.linalg.norm((off - slope @ step).reshape(-1, 2), axis=1)
                kept = size <= max(OUTLIER * float(np.median(size[kept])), 2 * least)
                count = int(kept.sum())
                if count < max(MIN_POINTS, AGREE * len(rays)):
                    return f"{count} of {len(rays)} points agree with one rotation"
                noise = SHARED * max(float((size[kept] ** 2).sum()) / (2 * count - 3), least**2)
            unknown = unknown + step
        rms = float(np.sqrt((size[kept] ** 2).mean()))
        if rms > WORST_PX * self._factor:
            return f"points misfit one rotation by {rms:.1f} px rms"
        covariance = np.linalg.inv(information)
        vector = unknown[:3]
        self._learn(vector, unknown[3:], covariance[3:, 3:])
        self._rate = vector / passed
        own = covariance[:3, :3] + UNMODELLED**2 * (vector @ vector) * np.eye(3)
        rows = tuple((float(a), float(b), float(c)) for a, b, c in own)
        x, y, z = (float(c) for c in vector)
        return Turn(since_s=before.t, vector=(x, y, z), covariance=(rows[0], rows[1], rows[2]))

    def _reduced(self, image: Image) -> Image:
        """Return a picture in grey, reduced and smoothed."""
        grey = grey_of(image)
        size = tuple(side // self._factor for side in grey.shape[::-1])
        grey = grey[: size[1] * self._factor, : size[0] * self._factor]
        small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        fine = cv2.GaussianBlur(small, (0, 0), SMOOTH_PX)
        coarse = cv2.blur(small, (SHADE_PX, SHADE_PX))
        return np.asarray(cv2.addWeighted(fine, GAIN, coarse, -GAIN, 128.0), np.uint8)

    def _follow(self, before: _View, now: _View, expected: Vector) -> tuple[Vector, Vector]:
        """Follow points of the background; return their pixels in both pictures, n x 2 each."""
        shape = before.grey.shape[::-1]
        open_ = cv2.resize(before.open, shape, interpolation=cv2.INTER_NEAREST)
        found = cv2.goodFeaturesToTrack(before.grey, POINTS, 0.01, SPACING_PX, mask=open_)
        if found is None:
            return np.empty((0, 2)), np.empty((0, 2))
        found = found + np.float32(OFFSETS_PX[: len(found), None])
        starts = self._whole(found)
        rays = camera_model.rays(self._calibration, starts)
        ahead = camera_model.project_points(
            self._calibration, self._seen(rays, expected, self._plane)
        )
        ahead = np.where(np.isfinite(ahead), ahead, starts)
        guess = np.float32((ahead + 0.5) / self._factor - 0.5).reshape(-1, 1, 2)
        after, ok, apart = cv2.calcOpticalFlowPyrLK(
            before.grey,
            now.grey,
            found,
            guess,
            winSize=(WINDOW_PX, WINDOW_PX),
            maxLevel=LEVELS,
            criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 15, 0.01),
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        ends = np.clip(self._whole(after), -1e6, 1e6)
        contrast = _contrast(before.grey, found)
        good = (ok.ravel() > 0) & (contrast > CONTRAST) & (apart.ravel() < MISMATCH * contrast)
        cells = np.rint(ends / self.background.step_px - 0.5).astype(int)
        inside = ((cells >= 0) & (cells < now.open.shape[::-1])).all(axis=1)
        good &= inside
        good[good] = now.open[cells[good, 1], cells[good, 0]] > 0
        return starts[good], ends[good]

    def _whole(self, points: NDArray[Any]) -> Vector:
        """Return the pixels of points of a reduced picture, n x 2."""
        return (points.reshape(-1, 2).astype(np.float64) + 0.5) * self._factor - 0.5

    def _seen(self, rays: Vector, vector: Vector, plane: Vector) -> Vector:
        """Return where points seen at rays are seen after a rotation of the camera, n x 3."""
        moved = rays - (rays @ plane)[:, None] * (self._lever @ vector)
        seen: Vector = moved @ _matrix(vector)
        return seen

    def _flow(self, rays: Vector, ends: Vector, unknown: Vector) -> tuple[Vector, Vector]:
        """Return the residuals [px], 2n, and their derivative by vector and plane, 2n x 6."""
        vector, plane = unknown[:3], unknown[3:]
        seen = self._seen(rays, vector, plane)
        off = ends - camera_model.project_points(self._calibration, seen)
        back = _matrix(vector).T
        # A small further rotation w moves r' by r' x w, and the camera by L w.
        by_vector = _cross(seen) - (rays @ plane)[:, None, None] * (back @ self._lever)
        by_plane = -(back @ self._lever @ vector)[:, None] * rays[:, None, :]
        by_pixel = camera_model.jacobian(self._calibration, seen)
        slope: Vector = by_pixel @ np.concatenate([by_vector, by_plane], axis=2)
        return off.ravel(), slope.reshape(-1, 6)

    def _learn(self, vector: Vector, plane: Vector, covariance: NDArray[np.floating[Any]]) -> None:
        """Keep the plane, as it is seen after the rotation."""
        back = _matrix(vector).T
        turned = back @ plane / (1 - plane @ self._lever @ vector)
        turned[2] = min(max(turned[2], 0.0), NEAREST)
        self._plane = turned
        spread = back @ covariance @ back.T
        self._spread = spread * min(1.0, 3 * INVERSE_DEPTH_STD**2 / np.trace(spread))


def _matrix(vector: Vector) -> Vector:
    """Return the matrix, 3x3, of a rotation vector."""
    return rotation.to_matrix(rotation.from_vector(vector.tolist()))


def _contrast(grey: Image, points: NDArray[Any]) -> Vector:
    """Return the standard deviation of the grey levels around points [grey levels]."""
    window = (WINDOW_PX, WINDOW_PX)
    mean, square = cv2.blur(grey, window), cv2.sqrBoxFilter(grey, cv2.CV_32F, window)
    u, v = np.rint(points.reshape(-1, 2)).astype(int).T
    var = square[v, u].astype(np.float64) - mean[v, u].astype(np.float64) ** 2
    deviation: Vector = np.sqrt(np.maximum(var, 0.0))
    return deviation


def _cross(points: Vector) -> Vector:
    """Return the matrices, n x 3 x 3, that take w to p x w."""
    x, y, z = points.T
    none = np.zeros(len(points))
    rows = [[none, -z, y], [z, none, -x], [-y, x, none]]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)
