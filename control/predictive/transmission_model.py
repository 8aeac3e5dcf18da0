"""Model of the transmission inside the lock, believed by how well it explains newer frames.

The candidates: no hysteresis; plays; plays and dead zones, per axis
(control/predictive/handle_history.py); and the capstan model of both axes
(control/predictive/capstan_model.py). They are fitted again and again, and compete on frames newer
than the fit: on the part of the bend's change within the prediction horizon that they leave
unexplained, which is what a model costs the lock.

With a background the bend itself is measured, up to a slow drift, as the sum of the camera's turns;
weights then follow by regression (control/predictive/increment_fit.py). Without one the target's
path is the nuisance: only what is not smooth counts (control/predictive/online_plays.py).
"""

from __future__ import annotations

from math import cos, hypot, sin
from typing import NamedTuple

import numpy as np

from endolock.control.predictive import handle_history, online_plays
from endolock.control.predictive.capstan_model import MIN_FRAMES, CapstanModel
from endolock.control.predictive.handle_history import (
    COLUMNS,
    HALF_WIDTHS,
    PLAYS,
    PRIOR,
    HandleHistory,
)
from endolock.control.predictive.increment_fit import SHIFTS_S, IncrementFit
from endolock.control.transmission.kinematics import LARGEST_BEND_RAD, Pair
from endolock.hw.api import Vector
from endolock.vision.observation import Turn

WINDOW_S = 25.0
"""Length of the past that is kept [s]."""
HORIZON_S = 0.45
"""Time within which a change of the bend is to be explained [s]: latency and lags."""
MEMORY_S = 4.0
"""Time constant of the candidates' errors [s]. Assumed: a turn of the target."""
CLEARLY = 0.85
"""Ratio of mean squared errors below which another candidate is chosen, which prevents frequent
changes."""
EARN = 0.8
"""Ratio below which the capstan replaces the columns; it leaves above 1."""
EXCITED_RAD = 0.02
"""Rms motion of a handle within a second below which nothing is learnt of its axis [rad]."""
OFTEN, SELDOM, YOUNG = 5, 25, 500
"""Frames between fits, at first and after the first `YOUNG` frames."""
DRIFT_KNOT_S = 6.0
"""Spacing of the knots of the measured bend's drift [s]. Assumed."""
RENEWAL = 0.5
"""Fraction of the step from the old to the found delay. Assumed."""
EVIDENT = 1.5
"""Ratio of squared errors, no hysteresis over the found loops, above which loops are evident."""
LEAST_RANGE_RAD, THROUGH_RAD = 0.1, 0.1
"""Range of a handle below which its axis is at rest, and by how much the handle must have gone
beyond a loop [rad]. Assumed."""
NARROW_RAD = 0.1
"""Standard deviation of a loop's width below which it is known [rad]. Assumed: a sixth of the
widest."""
SURPRISE, SURPRISE_RAD, PATIENCE_S = 6.0, 0.012, 3.0
"""Recent over usual squared error above which the transmission has changed, its least rms error
[rad], and the time before this is looked for again [s]. Assumed."""
LARGE_RAD2 = 1.0
"""Squared error of a capstan that is not to be used [rad2]."""
FORGET = 0.1
"""Factor on the evidence when the transmission has changed. Assumed."""
UNEXPLAINED, SLOPES, TRUST_FRAMES = 0.5, (0.45, 1.8), 50
"""Share of the measured turns that the handles must explain, range of their slope relative to that
of a common endoscope, and frames before this is judged: otherwise the background is not believed.
Assumed."""
TURN_RAD = 0.015
"""Rms turn within a second above which the background can be judged [rad]. Assumed."""


class SeenFrame(NamedTuple):
    """One frame in which the target was found."""

    t: float
    """Believed time of exposure [s]."""
    bend: Vector
    """Bend of the tip at that time, in axes of the video, 2 [rad]."""
    offset: Vector
    """Offset of the target from the optical axis, in bends, 2 [rad]."""
    columns: Vector
    """Columns at that time, 2 x `COLUMNS` [rad]."""
    turned: bool
    """Whether the bend was measured by the background, from the frame before."""


class TransmissionModel:
    """Candidates, evidence, and the model in use.

    Args:
        t: present time [s].
        handles: present handle angles, at which everything is at rest [rad].
        capstan: whether the capstan model is a candidate.
        dead_zones: whether dead zones are.
        background: whether turns of the camera are used.
    """

    def __init__(
        self, t: float, handles: Pair, *, capstan: bool, dead_zones: bool, background: bool
    ) -> None:
        self.history = HandleHistory(handles)
        self.history.follow(t, handles)
        self.weights = np.array([PRIOR, PRIOR])
        """Weights of the columns in use, 2 x `COLUMNS` [rad/rad]."""
        self.width_std = np.full(2, np.pi)
        """Standard deviation of the mean loop width of each axis [rad]."""
        self.shift_s = self.shift_std_s = 0.0
        """Delay of the exposures relative to their believed times, and its std [s]."""
        self.frames: list[SeenFrame] = []
        """The newest frames, oldest first."""
        self.capstan = CapstanModel()
        self.capstan_used = False
        """Whether the capstan is used instead of the columns."""
        self.background = False
        """Whether the bend is measured by the background."""
        self.turned_rad: Pair | None = None
        """Change of the bend since the frame before, by the background [rad]."""
        self._options = capstan, dead_zones, background
        self._fit = IncrementFit()
        self._candidates = np.array([[PRIOR] * 3] * 2)
        self._errors = np.full((2, 3), 1e-6)
        self._choice = [0, 0]
        self._by_capstan = self._by_columns = 1e-6
        self._recent = self._usual = 1e-5
        self._patient_s = 0.0
        self._count = 0
        self._trusted = True

    @property
    def widths(self) -> Vector:
        """Mean full loop width of each axis [rad]."""
        width: Vector = 2 * (self.weights @ HALF_WIDTHS) / self.slopes
        return width

    @property
    def slopes(self) -> Vector:
        """Bend per handle angle of each axis in long strokes [rad/rad]."""
        slopes: Vector = np.maximum(self.weights.sum(axis=1), 0.1)
        return slopes

    @property
    def bend(self) -> Vector:
        """Present bend by the model, in axes of the video [rad]."""
        if self.capstan_used:
            bend: Vector = self.capstan.bends[-1] @ self._turned()
        else:
            bend = np.einsum("ak,ak->a", self.weights, self.history.columns[-1])
        return bend

    @property
    def known(self) -> bool:
        """Whether the target may be predicted: by the background, or with evident loops."""
        if self.background or self.capstan_used:
            return True
        return self._evident()

    @property
    def error_rad(self) -> float:
        """Usual rms change of the bend within the horizon that the model does not explain [rad]."""
        return float(np.sqrt(self._usual))

    def follow(self, t: float, handles: Pair) -> None:
        """Run all models on measured handle angles."""
        self.history.follow(t, handles)
        self.capstan.follow(self.history)

    def bends_at(self, t: Vector) -> Vector:
        """Bends by the model at past times, in axes of the video, n x 2 [rad]."""
        if self.capstan_used:
            bends: Vector = self.capstan.bends_at(self.history, t) @ self._turned()
        else:
            bends = np.einsum("ak,nak->na", self.weights, self.history.columns_at(t))
        return bends

    def handles_for(self, bend: Vector, reach: float) -> Pair:
        """Nearest handle angles at which the model has a bend, in axes of the video [rad]."""
        up_down, left_right = self.history.handles.tolist()
        if self.capstan_used:
            wanted = self._turned() @ bend
            return self.capstan.handles_for(
                (float(wanted[0]), float(wanted[1])), (up_down, left_right)
            )
        first, second = (
            handle_history.handle_for(
                self.weights[axis],
                self.history.outputs[axis],
                handle,
                float(bend[axis]),
                reach=reach,
            )
            for axis, handle in enumerate((up_down, left_right))
        )
        return first, second

    def tip_at(self, t: float, turn: Turn | None) -> tuple[Vector, bool]:
        """Bend at a new frame; whether it was measured.

        Args:
            t: believed time of exposure [s].
            turn: rotation of the camera since an earlier frame.
        """
        self.turned_rad = None
        shifts = np.append(SHIFTS_S, self.shift_s)
        columns = self.history.columns_at(t + shifts)
        model = self.bends_at(np.array([t + self.shift_s]))[0]
        if not self.frames:
            return model, False
        since = self._frame_at(turn.since_s) if turn is not None and self._options[2] else None
        if turn is None or since is None:
            if not self.background:
                return model, False
            last = self.frames[-1]
            return last.bend + model - self.bends_at(np.array([last.t + self.shift_s]))[0], False
        moved = np.linalg.lstsq(
            _right_jacobian(since.bend)[:, :2], np.array(turn.vector), rcond=None
        )
        if since is self.frames[-1]:
            self.turned_rad = float(moved[0][0]), float(moved[0][1])
        variance = np.array([turn.covariance[0][0], turn.covariance[1][1]])
        before = self.history.columns_at(since.t + SHIFTS_S)
        self._fit.add(columns[:-1] - before, moved[0], variance, t - since.t)
        return (since.bend + moved[0] if self.background else model), True

    def add(self, frame: SeenFrame) -> None:
        """Add a frame; the candidates compete on it."""
        self.frames.append(frame)
        while self.frames[0].t < frame.t - WINDOW_S:
            del self.frames[0]
        self._count += 1
        self._compete(frame)

    def learn(self, t: float) -> bool:
        """Fit and choose again, where it is time; return whether the model in use changed.

        Args:
            t: present time [s].
        """
        changed = self._look_for_background()
        if len(self.frames) < 2:
            return changed
        if self._surprised(t):
            self._fit.discount(FORGET)
            self.capstan.forget()
            self._by_capstan = LARGE_RAD2
            self.capstan_used = False
            changed = True
        every = OFTEN if self.background and self._count < YOUNG else SELDOM
        if not self.background:
            every = SELDOM
        if self._count % every == 0:
            changed |= self._identify()
        return changed

    def work(self) -> bool:
        """Search for the capstan, a slice; return whether the model in use changed."""
        if not self._options[0] or len(self.frames) < MIN_FRAMES:
            return False
        rows = np.zeros((0, 3))
        if self.capstan.idle:
            sign = -1.0 if self.background else 1.0
            path = [f.bend if self.background else f.offset for f in self.frames]
            rows = np.column_stack([[f.t for f in self.frames], sign * np.array(path)])
        knot = DRIFT_KNOT_S if self.background else online_plays.KNOT_S
        replaced = self.capstan.work(self.history, rows, knot)
        used = self.capstan_used
        if replaced and not used:
            self._by_capstan = max(self._by_capstan, self._by_columns)  # it is new: it must earn it
        if self.capstan.ready(self.history):
            self.capstan_used = self._by_capstan < (1.0 if used else EARN) * self._by_columns
        changed = self.capstan_used is not used or (replaced and used)
        if changed and self.capstan_used:
            self.shift_s = self.capstan.search.parameters.shift_s
        return changed

    def _turned(self) -> Vector:
        """Rotation from axes of the video to those of the wires, 2 x 2."""
        angle = self.capstan.search.parameters.video_turn_rad if self.capstan_used else 0.0
        return np.array([[cos(angle), -sin(angle)], [sin(angle), cos(angle)]])

    def _frame_at(self, t: float) -> SeenFrame | None:
        for frame in reversed(self.frames[-10:]):
            if abs(frame.t - t) < 1e-6:
                return frame
        return None

    def _compete(self, frame: SeenFrame) -> None:
        """Charge each candidate for what it leaves unexplained of this frame's change."""
        middle = self._frame_before(frame.t - HORIZON_S / 2)
        first = self._frame_before(frame.t - HORIZON_S)
        if first is None or middle is None:
            return
        if self.background:
            parts = [(1.0, frame), (-1.0, first)]
            path = "bend"
        else:  # against a smooth path of the target
            parts = [(1.0, frame), (-2.0, middle), (1.0, first)]
            path = "offset"
        sign = 1.0 if self.background else -1.0
        change = sign * sum(part * getattr(one, path) for part, one in parts)
        columns = sum(part * one.columns for part, one in parts)
        left = change[:, None] - np.einsum("ack,ak->ac", self._candidates, columns)
        share = (frame.t - self.frames[-2].t) / MEMORY_S
        self._errors += min(share, 1.0) * (left**2 - self._errors)
        by_columns = change - np.einsum("ak,ak->a", self.weights, columns)
        by_used = by_columns
        self._by_columns += min(share, 1.0) * (float(by_columns @ by_columns) - self._by_columns)
        if len(self.capstan.bends) > 1:
            found = self.capstan.search.parameters
            times = np.array([one.t for _, one in parts]) + found.shift_s
            angle = found.video_turn_rad
            turned = np.array([[cos(angle), -sin(angle)], [sin(angle), cos(angle)]])
            bends = self.capstan.bends_at(self.history, times) @ turned
            by_capstan = change - np.array([part for part, _ in parts]) @ bends
            self._by_capstan += min(share, 1.0) * (
                float(by_capstan @ by_capstan) - self._by_capstan
            )
            by_used = by_capstan if self.capstan_used else by_columns
        self._recent += min(8 * share, 1.0) * (float(by_used @ by_used) - self._recent)
        self._usual += min(share / 5, 1.0) * (float(by_used @ by_used) - self._usual)

    def _frame_before(self, t: float) -> SeenFrame | None:
        for frame in reversed(self.frames):
            if frame.t <= t:
                return frame
        return None

    def _surprised(self, t: float) -> bool:
        """Whether the model in use has just become much worse than it was."""
        if self._count < 250 or t < self._patient_s:
            return False
        if self._recent < max(SURPRISE * self._usual, SURPRISE_RAD**2):
            return False
        self._patient_s = t + PATIENCE_S
        return True

    def _look_for_background(self) -> bool:
        """Decide whether the bend is measured by the background; return whether that changed."""
        turned = [frame.turned for frame in self.frames[-50:]]
        seen = sum(turned) > len(turned) / 2
        if self._fit.count > TRUST_FRAMES and self._count % SELDOM == 0:
            self._trusted = all(self._handles_explain(axis) for axis in range(2))
        before, self.background = self.background, seen and self._trusted and self._options[2]
        return self.background is not before

    def _handles_explain(self, axis: int) -> bool:
        fit = self._fit
        turned = fit.explained(axis)
        if turned < TURN_RAD**2:
            return True
        best = fit.solve(axis, self.shift_s, dead_zones=True)
        slope = float(best.weights.sum()) / float(PRIOR.sum())
        return best.residual < UNEXPLAINED * turned and SLOPES[0] < slope < SLOPES[1]

    def _evident(self) -> bool:
        """Whether loops are evident without a background, on each axis that moves.

        The handle has gone through the loop and beyond it, and the loop explains newer frames
        better than none, or it is known to be narrow.
        """
        recent = self.history.times > self.history.times[-1] - WINDOW_S
        ranges = np.ptp(self.history.angles[recent], axis=0)
        moving = ranges > LEAST_RANGE_RAD
        if not moving.any():
            return False
        chosen = self._errors[[0, 1], self._choice]
        better = self._errors[:, 0] > EVIDENT * chosen
        through = ranges > self.widths + THROUGH_RAD
        sure = self.width_std < NARROW_RAD
        return bool(np.all(~moving | (through & (better | sure))))

    def _identify(self) -> bool:
        """Fit the columns; return whether those in use changed."""
        moved = [self._fit.moved(axis) > EXCITED_RAD**2 for axis in range(2)]
        if self.background:
            for axis in range(2):
                if moved[axis]:
                    self._fit_axis(axis)
        elif not self._identify_by_splines():
            return False
        before = self.weights
        self.weights = np.array([self._candidates[a, self._choose(a)] for a in range(2)])
        if self.background and self._count % SELDOM == 0 and any(moved) and not self.capstan_used:
            self._find_shift()
        return not np.array_equal(before, self.weights) and not self.capstan_used

    def _fit_axis(self, axis: int) -> None:
        plays = self._fit.solve(axis, self.shift_s, dead_zones=False)
        self._candidates[axis, 1] = self._candidates[axis, 2] = plays.weights
        if self._options[1]:
            self._candidates[axis, 2] = self._fit.solve(axis, self.shift_s, dead_zones=True).weights
        self.width_std[axis] = plays.width_std

    def _identify_by_splines(self) -> bool:
        seen = np.array([(f.t, *f.offset) for f in self.frames])
        if len(seen) < MIN_FRAMES:
            return False
        found = online_plays.identify(
            seen[:, 0],
            seen[:, 1:],
            self.history.times,
            self.history.columns[:, :, :PLAYS],
            PRIOR[:PLAYS],
            HALF_WIDTHS[:PLAYS],
            self.shift_s,
        )
        if found is None:
            return False
        self.shift_s += 0.3 * (found.shift_s - self.shift_s)
        self.shift_std_s = found.shift_std_s
        for axis, (weights, std) in enumerate(zip(found.weights, found.width_std, strict=True)):
            if weights is not None:
                full = np.zeros(COLUMNS)
                full[:PLAYS] = weights
                self._candidates[axis, 1] = self._candidates[axis, 2] = full
                self.width_std[axis] = std
        return True

    def _choose(self, axis: int) -> int:
        """Choose a candidate of an axis by its errors on newer frames."""
        errors = self._errors[axis]
        best = int(np.argmin(errors))
        if errors[best] < CLEARLY * errors[self._choice[axis]]:
            self._choice[axis] = best
        return self._choice[axis]

    def _find_shift(self) -> None:
        first, second = (self._fit.unexplained(axis, self.weights[axis]) for axis in range(2))
        left = first + second
        best = int(np.clip(np.argmin(left), 1, len(SHIFTS_S) - 2))
        below, least, above = left[best - 1 : best + 2]
        curved = below - 2 * least + above
        if curved > 0:
            step = float(np.clip(0.5 * (below - above) / curved, -1, 1))
            found = SHIFTS_S[best] + step * (SHIFTS_S[1] - SHIFTS_S[0])
            self.shift_s += RENEWAL * (found - self.shift_s)
            spread = 2 * least / (curved * max(self._fit.independent, 1.0))
            self.shift_std_s = float(np.sqrt(spread)) * (SHIFTS_S[1] - SHIFTS_S[0])


def _right_jacobian(bend: Vector) -> Vector:
    """Derivative of the camera's rotation, in its axes, by the rotation vector of the tip, 3 x 3.

    1 - (1 - cos t)/t^2 K + (t - sin t)/t^3 K^2, with K the cross product with the vector of size t.
    """
    up_down, left_right = float(bend[0]), float(bend[1])
    t = min(hypot(up_down, left_right), LARGEST_BEND_RAD)
    cross = np.array([[0, 0, left_right], [0, 0, -up_down], [-left_right, up_down, 0]])
    if t < 1e-4:
        return np.eye(3) - cross / 2
    jacobian: Vector = np.eye(3) - (1 - cos(t)) / t**2 * cross + (t - sin(t)) / t**3 * cross @ cross
    return jacobian
