"""Model of the transmission inside the lock, believed by how well it explains newer frames.

The candidates: no hysteresis; plays; plays and dead zones, per axis
(control/predictive/handle_history.py); and the capstan model of both axes
(control/predictive/capstan_model.py). They are fitted again and again, and compete on frames newer
than the fit: on the part of the bend's change within the prediction horizon that they leave
unexplained, which is what a model costs the lock.

With a background the bend itself is measured, up to a slow drift, as the sum of the camera's turns;
weights then follow by regression (control/predictive/increment_fit.py). Without one the target's
path is the nuisance: only what is not smooth counts (control/predictive/online_plays.py), and loops
are believed once they are evident (control/predictive/loop_belief.py).
"""

from __future__ import annotations

from collections import deque

import numpy as np

from endolock.control.predictive import loop_evidence, model_belief, online_plays
from endolock.control.predictive.capstan_model import MIN_FRAMES
from endolock.control.predictive.competition import Competition
from endolock.control.predictive.increment_fit import SHIFTS_S, IncrementFit
from endolock.control.predictive.loop_belief import LoopBelief
from endolock.control.predictive.model_in_use import ModelInUse
from endolock.control.predictive.seen_frames import NEWEST, SeenFrame, TipSeen, bend_change, tip_of
from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import Vector
from endolock.vision.observation import Turn

WINDOW_S = 25.0
"""Length of the past that is kept [s]."""
EXCITED_RAD = 0.02
"""Rms motion of a handle within a second below which nothing is learnt of its axis [rad]."""
OFTEN, SELDOM, YOUNG = 5, 25, 500
"""Frames between fits, at first and after the first `YOUNG` frames."""
SOON, SPLINE_FRAMES = 10, 50
"""Frames between fits without a background while no loop is known, and least frames of a fit."""
OLD = 250
"""Frames after which a change of the transmission is looked for. Assumed."""
DRIFT_KNOT_S = 6.0
"""Spacing of the knots of the measured bend's drift [s]. Assumed."""
RENEWAL = 0.5
"""Fraction of the step from the old to the found delay. Assumed."""
FORGET = 0.02
"""Factor on the evidence when the transmission has changed. Assumed."""
SINCE_S = 1.5
"""Time before a change is noticed from which on frames show it [s]. Assumed: latency and the
time until it is noticed."""


class TransmissionModel(ModelInUse):
    """The model in use, with the candidates and the evidence from which it is chosen.

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
        super().__init__(t, handles)
        self.shift_s = self.shift_std_s = 0.0
        """Delay of the exposures relative to their believed times, and its std [s]."""
        self.frames: list[SeenFrame] = []
        """The newest frames, oldest first."""
        self.loops = LoopBelief()
        """Loops that are believed without a background."""
        self.background = False
        """Whether the bend is measured by the background."""
        self.turned_rad: Pair | None = None
        """Change of the bend since the frame before, by the background [rad]."""
        self._options = capstan, dead_zones, background
        self._fit = IncrementFit()
        self._rivals = Competition()
        self._tips: deque[TipSeen] = deque(maxlen=NEWEST)
        self._count = 0
        self._trusted = True
        self._added = False

    @property
    def known(self) -> bool:
        """Whether the target may be predicted: by the background, or with evident loops."""
        if self.background or self.capstan_used:
            return True
        return all(self.loops.known)

    @property
    def error_rad(self) -> float:
        """Usual rms change of the bend within the horizon that the model does not explain [rad]."""
        return float(np.sqrt(self._rivals.usual))

    def tip_at(self, t: float, turn: Turn | None) -> TipSeen:
        """Bend at a new frame, measured or by the model; also of one that does not show the target.

        Args:
            t: believed time of exposure [s].
            turn: rotation of the camera since an earlier frame.
        """
        self.turned_rad = None
        turn = turn if self._options[2] else None
        since = tip_of(self._tips, turn.since_s) if turn is not None else None
        times = [*(t + SHIFTS_S).tolist(), t + self.shift_s]
        times += (since.t + SHIFTS_S).tolist() if since else []
        known = self.history.columns_at(np.array(times))
        columns, before = known[: len(SHIFTS_S) + 1], known[len(SHIFTS_S) + 1 :]
        model: Vector = self.bends_at(np.array([t + self.shift_s]))[0]
        if turn is None or since is None:
            bend = model
            if self.background:
                last = self._tips[-1]
                bend = last.bend + model - self.bends_at(np.array([last.t + self.shift_s]))[0]
            self._tips.append(TipSeen(t, bend, model, columns[-1], False))
            return self._tips[-1]
        moved = bend_change(np.array(turn.vector), since.bend)
        if since is self._tips[-1]:
            self.turned_rad = float(moved[0]), float(moved[1])
        variance = np.array([turn.covariance[0][0], turn.covariance[1][1]])
        self._fit.add(columns[:-1] - before, moved, variance, t - since.t)
        bend = since.bend + moved if self.background else model
        self._tips.append(TipSeen(t, bend, model, columns[-1], True))
        return self._tips[-1]

    def add(self, frame: SeenFrame) -> None:
        """Add a frame; the candidates compete on it."""
        self.frames.append(frame)
        while self.frames[0].t < frame.t - WINDOW_S:
            del self.frames[0]
        self._count += 1
        self._added = True
        self._rivals.judge(
            self.frames,
            self.weights,
            self.capstan,
            self.history,
            turn=self.turn_rad,
            background=self.background,
            capstan_used=self.capstan_used,
        )

    def learn(self, t: float) -> bool:
        """Fit and choose again, where it is time; return whether the model in use changed.

        Args:
            t: present time [s].
        """
        if not self._added:
            return False
        self._added = False
        changed = self._look_for_background()
        if len(self.frames) < 2:
            return changed
        if self._count >= OLD and self._rivals.surprised(t):
            self._fit.discount(FORGET)
            self.capstan.changed(t - SINCE_S, measured=self.background)
            if not self.background:
                self.capstan_used, changed = False, True
        every = OFTEN if self.background and self._count < YOUNG else SELDOM
        if not self.background and not self.known:
            every = SOON
        if self._count % every == 0:
            changed |= self._identify()
        elif self.background and self._count % 2:
            self._fit.look_for_delay(self._options[1], self.turn_rad)
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
        if replaced:
            self._rivals.capstan_replaced(
                self.frames,
                self.weights,
                self.capstan,
                self.history,
                turn=self.turn_rad,
                background=self.background,
            )
        if self.capstan.ready(self.history):
            self.capstan_used = self._rivals.capstan_earns(used) and self.known
        changed = self.capstan_used is not used or (replaced and used)
        if changed and self.capstan_used:
            self.shift_s = self.capstan.search.parameters.shift_s
        return changed

    def _look_for_background(self) -> bool:
        """Decide whether the bend is measured by the background; return whether that changed."""
        turned = [frame.turned for frame in self.frames[-50:]]
        seen = sum(turned) > len(turned) / 2
        if self._fit.count > model_belief.TRUST_FRAMES and self._count % SELDOM == 0:
            self._trusted = model_belief.handles_explain(self._fit, self.shift_s, self.turn_rad)
        before, self.background = self.background, seen and self._trusted and self._options[2]
        return self.background is not before

    def _identify(self) -> bool:
        """Fit the columns; return whether those in use changed."""
        moved = [self._fit.moved(axis) > EXCITED_RAD**2 for axis in range(2)]
        turn = self.turn_rad
        if self.background:
            if any(moved):
                self.turn_rad = self._fit.look_for_turn(self.shift_s, self._options[1], turn)
            for axis in range(2):
                if moved[axis]:
                    self._fit_axis(axis)
        elif not self._identify_by_splines():
            return False
        before = self.weights
        if self.background:
            self.weights = self._rivals.choose()
            for axis in range(2):
                if moved[axis]:
                    self.loops.adopt(axis, self.weights[axis], float(self.width_std[axis]))
        else:
            self.weights = self._rivals.chosen()
        if self.background and self._count % SELDOM == 0 and any(moved) and not self.capstan_used:
            self._find_shift()
        same = np.array_equal(before, self.weights) and turn == self.turn_rad
        return not same and not self.capstan_used

    def _fit_axis(self, axis: int) -> None:
        plays = self._fit.solve(axis, self.shift_s, False, self.turn_rad)
        self._rivals.candidates[axis, 1] = self._rivals.candidates[axis, 2] = plays.weights
        if self._options[1]:
            self._rivals.candidates[axis, 2] = self._fit.solve(
                axis, self.shift_s, True, self.turn_rad
            ).weights
        self.width_std[axis] = plays.width_std

    def _identify_by_splines(self) -> bool:
        seen = np.array([(f.t, *f.offset) for f in self.frames])
        if len(seen) < SPLINE_FRAMES:
            return False
        found = online_plays.identify(
            seen[:, 0], seen[:, 1:], self.history, self.shift_s, dead_zones=self._options[1]
        )
        if found is None:
            return False
        clear = found.surer > loop_evidence.NEARLY
        share = 1.0 if clear and not self.known else 0.3
        self.loops.renew(found.axes, doubt=not clear)  # another delay explains more
        evident = any(one is not None and one.loop.evident for one in found.axes)
        if evident or (self.known and clear):
            self.shift_s += share * (found.shift_s - self.shift_s)
            self.shift_std_s = found.shift_std_s
        for axis in range(2):
            self._rivals.candidates[axis, 1:] = self.loops.weights[axis]
            self.width_std[axis] = self.loops.width_std[axis]
            self._rivals.choice[axis] = int(self.loops.known[axis])
        return True

    def _find_shift(self) -> None:
        found = self._fit.delay(self.shift_s)
        if found is not None:
            self.shift_s += RENEWAL * (found[0] - self.shift_s)
            self.shift_std_s = found[1]
