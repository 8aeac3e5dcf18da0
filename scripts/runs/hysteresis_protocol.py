"""The quasi-static strokes of `endolock hysteresis`, on any rig with a pose tracker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import degrees, inf, isfinite

import numpy as np

from endolock.control.identification.hysteresis_loop import FOLLOWED_RAD, Branch
from endolock.control.loop import PERIOD_S, Recorder, Tick, ticks
from endolock.hw.api import AXES, Command, ConfigError, Rig, Vector
from endolock.vision.observation import Status

SPEED_RAD_S = 0.2
"""Handle speed [rad/s]; at half this speed no width differs by more than 1 %."""
HIGHEST_BEND_RAD = np.radians(115.0)
"""Bend at which strokes end, so that the loop is open at 90 deg; or at the handle's limit."""
TURNS_DEG = (90, 60, 30)
"""Bends at which the one-sided strokes turn back."""
MARGIN_RAD = 0.02
"""Distance of the handles from their limits [rad]."""
STOP_ROWS = 5
"""Poses averaged to detect the end of a stroke, a delay of 0.1 s or 0.6 deg of bend."""
SETTLE_S = 1.0
DRIFT_S = 30.0
"""Settling time, and duration of the drift measurement [s]: 0.05 deg of noise at 100 Hz gives an
error of 0.01 deg/min."""


@dataclass
class RecordedStrokes:
    """Records of the protocol, per stroke of the axis under test."""

    reached_rad: float
    """Handle angle of the crests [rad]."""
    loop: tuple[Branch, Branch]
    """The falling branch from crest to trough, and the rising branch back."""
    one_sided: dict[str, dict[int, tuple[Branch, Branch]]] = field(default_factory=dict)
    """By "positive" or "negative", and each of `TURNS_DEG` that was reached and is far enough from
    the bend that remains at handle zero: the branch out to that bend, from handle zero approached
    on the same side, and the branch back to zero."""
    drift_deg_per_min: float = 0.0
    """Drift of the bend with the handles held [deg/min]."""


class Protocol:
    """Turns the handles of a rig slowly and records its tracker.

    Args:
        rig: the rig, connected and enabled here; its handles hold after an exception.
        axis: 0 up_down, 1 left_right.
        progress: called with the time after each tick [s].

    Raises:
        ConfigError: the rig has no tracker, or its tracker does not see the tip.
    """

    def __init__(
        self,
        rig: Rig,
        axis: int,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        if rig.tracker is None:
            raise ConfigError(
                "this rig has no pose tracker", "use a rig with one, such as --rig twin"
            )
        self._rig, self._tracker, self._axis = rig, rig.tracker, axis
        self._recorder: Recorder | None = None
        self._progress = progress
        rig.actuators.connect()
        rig.actuators.enable()
        self._goal = list(rig.actuators.exchange(None).position)
        self._move(axis, self._goal[axis], wait_s=SETTLE_S)

    def run(self, recorder: Recorder | None = None, *, whole: bool = True) -> RecordedStrokes:
        """Record the loop, the one-sided strokes and the drift.

        Args:
            recorder: receives every tick.
            whole: False to record only the loop.

        Raises:
            HardwareError: the handles stopped.
        """
        self._recorder = recorder
        try:
            low, high = self._rig.actuators.limits.position_rad[self._axis]
            crest = self._until(min(high, -low) - MARGIN_RAD, self._axis, HIGHEST_BEND_RAD)
            falling = self._stroke(-crest)
            found = RecordedStrokes(crest, (falling, self._stroke(crest)))
            if whole:
                self._stroke(0.0)
                for side, peak in (("positive", crest), ("negative", -crest)):
                    found.one_sided[side] = self._one_sided(peak)
                self._stroke(crest / 2)
                found.drift_deg_per_min = self._drift()
            return found
        finally:
            self._rig.actuators.hold()

    def bend_other_axis(self, bend_rad: float) -> float:
        """Turn the other handle until the tracker shows the bend, and hold it.

        Returns:
            The bend reached [rad].

        Raises:
            ConfigError: the bend is out of reach, or not a finite number.
            HardwareError: the handles stopped.
        """
        if not isfinite(bend_rad):
            raise ConfigError(f"--other-axis-deg {bend_rad}", "use a number of degrees, such as 60")
        try:
            return self._bend_other_axis(bend_rad)
        except BaseException:
            self._rig.actuators.hold()
            raise

    def _bend_other_axis(self, bend_rad: float) -> float:
        other = 1 - self._axis
        if bend_rad == 0:
            return 0.0
        low, high = self._rig.actuators.limits.position_rad[other]
        end = high - MARGIN_RAD if bend_rad > 0 else low + MARGIN_RAD
        self._until(end, other, abs(bend_rad))
        _, _, bends = self._move(other, self._goal[other], wait_s=SETTLE_S)
        reached = float(np.mean(bends[len(bends) // 2 :]))
        if abs(reached) < 0.95 * abs(bend_rad):
            raise ConfigError(
                f"{AXES[other]} bends to {degrees(reached):.0f} deg at most, not to "
                f"{degrees(bend_rad):.0f}",
                "use a smaller --other-axis-deg",
            )
        return reached

    def _until(self, end: float, axis: int, bend_rad: float) -> float:
        """Turn a handle towards `end` until the tracker shows a bend; return the angle [rad]."""
        self._move(axis, end, stop_at=bend_rad)
        return self._goal[axis]

    def _stroke(self, end: float) -> Branch:
        _, handle, bend = self._move(self._axis, end)
        return Branch(handle, bend)

    def _one_sided(self, peak: float) -> dict[int, tuple[Branch, Branch]]:
        self._until(peak, self._axis, np.radians(TURNS_DEG[0]))
        back = self._stroke(0.0)
        strokes = {}
        for turn in TURNS_DEG:
            left = abs(float(np.mean(back.bend[-STOP_ROWS:])))
            if np.radians(turn) < left + FOLLOWED_RAD[1]:
                break  # the remaining bend hides the lost motion at either turn
            _, handle, bend = self._move(self._axis, peak, stop_at=np.radians(turn))
            back = self._stroke(0.0)
            if abs(back.bend[0]) > np.radians(turn - 1):
                strokes[turn] = (Branch(handle, bend), back)
        return strokes

    def _drift(self) -> float:
        self._move(self._axis, self._goal[self._axis], wait_s=SETTLE_S)
        t, _, bend = self._move(self._axis, self._goal[self._axis], wait_s=DRIFT_S)
        return degrees(abs(float(np.polyfit(t / 60, bend, 1)[0])))

    def _move(
        self, axis: int, end: float, *, stop_at: float = inf, wait_s: float = 0.0
    ) -> tuple[Vector, Vector, Vector]:
        """Turn a handle to an angle, or wait; return times, angles and bends of the new poses."""
        rig, rows, newest = self._rig, [], -inf
        start = self._goal[axis]
        duration = abs(end - start) / SPEED_RAD_S + wait_s
        began = rig.clock.now()
        command: Command | None = None
        for t, skipped in ticks(rig.clock, PERIOD_S, began + duration):
            state = rig.actuators.exchange(command)
            pose = self._tracker.latest()
            if self._recorder:
                self._recorder.tick(
                    Tick(
                        t=t,
                        skipped=skipped,
                        command=command,
                        state=state,
                        status=Status.SEARCHING,
                        tracked=pose,
                        truth=None,
                    )
                )
            if pose and pose.t > newest and pose.t >= began:
                newest = pose.t
                handle = rig.actuators.history(pose.t).position[axis]
                rows.append((pose.t, handle, pose.rotation_vector[axis]))
                recent = [row[-1] for row in rows[-STOP_ROWS:]]
                if len(recent) == STOP_ROWS and abs(sum(recent)) / STOP_ROWS >= stop_at:
                    break
            travelled = min(abs(end - start), SPEED_RAD_S * (t + PERIOD_S - began))
            self._goal[axis] = start + np.copysign(travelled, end - start)
            command = Command(position=tuple(self._goal))
            if self._progress:
                self._progress(t)
        if len(rows) < 2:
            raise ConfigError(
                f"the pose tracker gave {len(rows)} poses in {duration:.1f} s",
                "check that the tip is in its view, and that its rate is 10 Hz or more",
            )
        times, angles, bends = np.array(rows).T
        return times, angles, bends
