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
SURPRISE, SURPRISE_RAD, PATIENCE_S = 6.0, 0.012, 12.0
"""Recent over usual squared error above which the transmission has changed, its least rms error
[rad], and the time before this is looked for again [s]. Assumed."""
NEW_FRAMES = 25
"""Number of frames for which a new capstan counts as good as the one before, or as the columns if
that was worse [1]: a second."""
JUDGED_S = 0.2
"""Time that the errors before a change count for [s]. Assumed."""


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
        self._judged_s = MEMORY_S

    def judge(
        self,
        frames: list[SeenFrame],
        weights: Vector,
        capstan: CapstanModel,
        history: HandleHistory,
        *,
        turn: float,
        background: bool,
        capstan_used: bool,
    ) -> None:
        """Charge each candidate for what it leaves unexplained at the newest frame.

        Args:
            frames: frames, oldest first, 2 or more.
            weights: weights of the columns in use, 2 x `COLUMNS` [rad/rad].
            capstan: the other model.
            history: handle angles that it has followed.
            turn: rotation of the video that goes with the columns [rad].
            background: whether the bends of the frames were measured.
            capstan_used: whether the capstan is in use.
        """
        parts = _parts(frames, frames[-1], background)
        if parts is None:
            return
        change, columns = _changes(parts, background)
        along = rotation(turn) @ change
        left = along[:, None] - np.einsum("ack,ak->ac", self.candidates, columns)
        dt = max(frames[-1].t - frames[-2].t, 0.0)
        self._judged_s = min(self._judged_s + dt, MEMORY_S)
        share = dt / MEMORY_S
        since = min(dt / self._judged_s, 1.0)
        self.errors += min(share, 1.0) * (left**2 - self.errors)
        by_columns = along - np.einsum("ak,ak->a", weights, columns)
        by_used = by_columns
        self.by_columns += since * (float(by_columns @ by_columns) - self.by_columns)
        if len(capstan.bends) > 1:
            by_capstan = change - _capstan_changes([parts], capstan, history)[0]
            self.by_capstan += since * (float(by_capstan @ by_capstan) - self.by_capstan)
            by_used = by_capstan if capstan_used else by_columns
        else:  # it was never compared
            self.by_capstan = self.by_columns
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

    def capstan_replaced(
        self,
        frames: list[SeenFrame],
        weights: Vector,
        capstan: CapstanModel,
        history: HandleHistory,
        *,
        turn: float,
        background: bool,
    ) -> None:
        """Charge a new capstan on the frames since its window, relative to the columns in use.

        See `judge`.
        """
        found = [
            parts
            for frame in frames
            if frame.t > capstan.fitted_s + HORIZON_S
            and (parts := _parts(frames, frame, background)) is not None
        ]
        if not found:
            return
        both = [_changes(parts, background) for parts in found]
        change = np.array([one for one, _ in both])
        columns = np.array([one for _, one in both])
        by_capstan = change - _capstan_changes(found, capstan, history)
        by_columns = change @ rotation(turn).T - np.einsum("ak,nak->na", weights, columns)
        before = min(self.by_capstan, self.by_columns)
        left = float((by_capstan**2).sum()) + NEW_FRAMES * before
        by_rival = float((by_columns**2).sum()) + NEW_FRAMES * self.by_columns
        self.by_capstan = left / by_rival * self.by_columns

    def capstan_earns(self, used: bool) -> bool:
        """Whether the capstan is to be used, given whether it is."""
        return self.by_capstan < (1.0 if used else EARN) * self.by_columns

    def surprised(self, t: float) -> bool:
        """Whether the model in use has just become much worse than it was; both start anew then.

        Args:
            t: present time [s].
        """
        if t < self._patient_s:
            return False
        if self.recent < max(SURPRISE * self.usual, SURPRISE_RAD**2):
            return False
        self._patient_s = t + PATIENCE_S
        self.by_capstan = self.by_columns
        self._judged_s = JUDGED_S
        return True


def _parts(
    frames: list[SeenFrame], frame: SeenFrame, background: bool
) -> list[tuple[float, SeenFrame]] | None:
    """Frames within the horizon whose difference is to be explained; None if it is not seen yet."""
    first = frame_before(frames, frame.t - HORIZON_S)
    if first is not None and frame.t - first.t > 2 * HORIZON_S:
        return None  # a gap
    if background or first is None:
        return None if first is None else [(1.0, frame), (-1.0, first)]
    middle = frame_before(frames, frame.t - HORIZON_S / 2)
    assert middle is not None
    return [(1.0, frame), (-2.0, middle), (1.0, first)]  # against a smooth path of the target


def _changes(parts: list[tuple[float, SeenFrame]], background: bool) -> tuple[Vector, Vector]:
    """Difference of bends, 2 [rad], and of columns, 2 x `COLUMNS` [rad]."""
    change = sum(part * (one.bend if background else -one.offset) for part, one in parts)
    columns = sum(part * one.columns for part, one in parts)
    return np.array(change), np.array(columns)


def _capstan_changes(
    found: list[list[tuple[float, SeenFrame]]], capstan: CapstanModel, history: HandleHistory
) -> Vector:
    """The same difference by the capstan, n x 2 [rad]."""
    parameters = capstan.search.parameters
    times = np.array([[one.t for _, one in parts] for parts in found]) + parameters.shift_s
    bends = capstan.bends_at(history, times.ravel()).reshape(*times.shape, 2)
    weights = np.array([part for part, _ in found[0]])
    changes: Vector = np.einsum("p,npa->na", weights, bends) @ rotation(parameters.video_turn_rad)
    return changes
