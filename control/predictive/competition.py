"""Candidates for the transmission, compared on frames newer than they were fitted to.

Of each frame a candidate is charged for the part of the bend's change within the prediction horizon
that it leaves unexplained, which is what a model costs the lock. Without a background only what is
not smooth counts, the second difference of the offset, as the target moves too.
"""

from __future__ import annotations

import numpy as np

from endolock.control.predictive.capstan_model import CapstanModel, rotation
from endolock.control.predictive.handle_history import PRIOR, HandleHistory
from endolock.control.predictive.seen_frames import SeenFrame, frame_before
from endolock.hw.api import Vector

HORIZON_S = 0.45
"""Time within which a change of the bend is to be explained [s]: latency and lags."""
MEMORY_S = 4.0
"""Time constant of the candidates' errors [s]. Assumed: a turn of the target."""
CLEARLY = 0.85
"""Ratio of mean squared errors below which another candidate is chosen, which prevents frequent
changes."""
EARN = 0.8
"""Ratio below which the capstan replaces the columns; it leaves above 1."""
SURPRISE, SURPRISE_RAD, PATIENCE_S = 6.0, 0.012, 3.0
"""Recent over usual squared error above which the transmission has changed, its least rms error
[rad], and the time before this is looked for again [s]. Assumed."""
LARGE_RAD2 = 1.0
"""Squared error of a capstan that is not to be used [rad2]."""


class Competition:
    """Weights of the candidates of both axes, and their errors; the capstan's beside them."""

    def __init__(self) -> None:
        self.candidates = np.array([[PRIOR] * 3] * 2)
        """Weights of no hysteresis, plays, and plays and dead zones, 2 x 3 x `COLUMNS`."""
        self.errors = np.full((2, 3), 1e-6)
        """Mean squared errors of these [rad2]."""
        self.choice = [0, 0]
        """Candidate of each axis that is in use."""
        self.by_capstan = self.by_columns = 1e-6
        """Mean squared errors of the capstan and of the weights in use, both axes [rad2]."""
        self.recent = self.usual = 1e-5
        """Those of the model in use, within a half and within twenty seconds [rad2]."""
        self._patient_s = 0.0

    def judge(
        self,
        frames: list[SeenFrame],
        weights: Vector,
        capstan: CapstanModel,
        history: HandleHistory,
        *,
        background: bool,
        capstan_used: bool,
    ) -> None:
        """Charge each candidate for what it leaves unexplained at the newest frame.

        Args:
            frames: frames, oldest first, 2 or more.
            weights: weights of the columns in use, 2 x `COLUMNS` [rad/rad].
            capstan: the other model.
            history: handle angles that it has followed.
            background: whether the bends of the frames were measured.
            capstan_used: whether the capstan is in use.
        """
        frame = frames[-1]
        middle = frame_before(frames, frame.t - HORIZON_S / 2)
        first = frame_before(frames, frame.t - HORIZON_S)
        if first is None or middle is None:
            return
        if background:
            parts = [(1.0, frame), (-1.0, first)]
            path = "bend"
        else:  # against a smooth path of the target
            parts = [(1.0, frame), (-2.0, middle), (1.0, first)]
            path = "offset"
        sign = 1.0 if background else -1.0
        change = sign * sum(part * getattr(one, path) for part, one in parts)
        columns = sum(part * one.columns for part, one in parts)
        left = change[:, None] - np.einsum("ack,ak->ac", self.candidates, columns)
        share = (frame.t - frames[-2].t) / MEMORY_S
        self.errors += min(share, 1.0) * (left**2 - self.errors)
        by_columns = change - np.einsum("ak,ak->a", weights, columns)
        by_used = by_columns
        self.by_columns += min(share, 1.0) * (float(by_columns @ by_columns) - self.by_columns)
        if len(capstan.bends) > 1:
            found = capstan.search.parameters
            times = np.array([one.t for _, one in parts]) + found.shift_s
            bends = capstan.bends_at(history, times) @ rotation(found.video_turn_rad)
            by_capstan = change - np.array([part for part, _ in parts]) @ bends
            self.by_capstan += min(share, 1.0) * (float(by_capstan @ by_capstan) - self.by_capstan)
            by_used = by_capstan if capstan_used else by_columns
        self.recent += min(8 * share, 1.0) * (float(by_used @ by_used) - self.recent)
        self.usual += min(share / 5, 1.0) * (float(by_used @ by_used) - self.usual)

    def choose(self) -> Vector:
        """Choose a candidate of each axis; return their weights, 2 x `COLUMNS` [rad/rad]."""
        for axis, errors in enumerate(self.errors):
            best = int(np.argmin(errors))
            if errors[best] < CLEARLY * errors[self.choice[axis]]:
                self.choice[axis] = best
        return self.chosen()

    def chosen(self) -> Vector:
        """Weights of the candidate of each axis that is in use, 2 x `COLUMNS` [rad/rad]."""
        return np.array([self.candidates[axis, self.choice[axis]] for axis in range(2)])

    def capstan_replaced(self) -> None:
        """Let a capstan that is not in use, and is new, earn its place."""
        self.by_capstan = max(self.by_capstan, self.by_columns)

    def capstan_earns(self, used: bool) -> bool:
        """Whether the capstan is to be used, given whether it is."""
        return self.by_capstan < (1.0 if used else EARN) * self.by_columns

    def surprised(self, t: float) -> bool:
        """Whether the model in use has just become much worse than it was; the capstan is out then.

        Args:
            t: present time [s].
        """
        if t < self._patient_s:
            return False
        if self.recent < max(SURPRISE * self.usual, SURPRISE_RAD**2):
            return False
        self._patient_s = t + PATIENCE_S
        self.by_capstan = LARGE_RAD2
        return True
