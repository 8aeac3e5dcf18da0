"""Where a guard's handles are: what it believes of its drive's readings, and makes goals of."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from math import inf, nan

from endolock.hw.api import DeviceFault, LinkLost
from endolock.hw.confirmed import KEPT, NEEDED, Sample, confirmed
from endolock.hw.drive import Drive, Reading
from endolock.hw.errors import RESUME

MOST = 12
"""Readings until they are given up: five, and two that are wrong at any place of them."""
LOAD_RAD = 0.02
"""Largest distance from its goal at which a load keeps a handle [rad]. Assumed: 0.4 N m at the
twin's servo, whose wires pull with 0.1 N m."""


class Positions:
    """The last readings of every axis that were accepted, and what follows from them.

    Args:
        drive: whose readings they are.
    """

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        count = len(drive.axes)
        self._samples: tuple[deque[Sample], ...] = tuple(deque(maxlen=KEPT) for _ in range(count))
        # Where each handle rested when torque was last on, and how far ahead its goal was.
        self._loads: list[tuple[float, float] | None] = [None] * count
        self._last: Reading | None = None
        self._jumps = 0

    def forget(self) -> None:
        """Forget all that counts from another zero."""
        for samples in self._samples:
            samples.clear()
        self._loads = [None] * len(self._samples)
        self._last = None

    def accept(self, reading: Reading, goal: Sequence[float] | None = None) -> None:
        """Accept what a reading says about the axes that answered.

        Args:
            reading: the reading.
            goal: the goals in force, as the motors have them [rad]; None where torque is off.
        """
        self._last, self._jumps = reading, 0
        for i, (axis, samples) in enumerate(zip(self._drive.axes, self._samples, strict=True)):
            if reading.heard(axis):
                ahead = nan if goal is None else goal[i]
                samples.append(Sample(reading.t, reading.position[i], ahead))

    def believe(self, reading: Reading, goal: Sequence[float]) -> Reading:
        """Return and accept a reading of driven handles; if it cannot be, the last one, not fresh.

        Args:
            reading: as measured.
            goal: the goals in force, as the motors have them [rad].

        Raises:
            DeviceFault: three in a row cannot be.
        """
        for i, axis in enumerate(self._drive.axes):
            if not reading.heard(axis) or self._plausible(i, reading, goal[i]):
                continue
            self._jumps += 1
            if self._jumps >= NEEDED:
                raise DeviceFault(
                    f"handle {axis} reads {reading.position[i]:+.2f} rad, where it cannot be so "
                    f"soon, {NEEDED} times in a row; the goal is frozen",
                    "check the motor's encoder and firmware, and that nothing turns the handle",
                    kind="encoder",
                    recovery=RESUME,
                    t=self._drive.clock.now(),
                    axis=axis,
                )
            return replace(self._last or reading, fresh=False, goal=reading.goal, silent=())
        self.accept(reading, goal)
        return reading

    def confirm(self, call: str, risk: str) -> tuple[Reading, tuple[float, ...]]:
        """Measure until readings confirm each other; return the last one and the positions [rad].

        Args:
            call: what is to be called again if they do not.
            risk: what could happen if a single one were believed.

        Raises:
            LinkLost, DeviceFault: no answer, or no agreement; its recovery is `call` alone.
            HardwareError: of the drive.
        """
        for samples in self._samples:
            samples.clear()
        newest: Reading | None = None
        silent = 0
        for _ in range(MOST):
            reading = self._drive.transfer(None)
            self.accept(reading)
            silent = 0 if reading.fresh else silent + 1
            newest = reading if reading.fresh else newest
            if silent >= KEPT:
                who = " and ".join(reading.silent) or "the handles"
                raise LinkLost(
                    f"{who} do not answer, so {risk}",
                    "check cable and power",
                    recovery=(call,),
                    t=self._drive.clock.now(),
                    axis=reading.silent[0] if reading.silent else None,
                )
            found = self._confirmed()
            position = tuple(at for at in found if at is not None)
            if newest is not None and len(position) == len(found):
                return newest, position
        axis = self._drive.axes[found.index(None)]
        raise DeviceFault(
            f"{MOST} readings of handle {axis} do not agree, so {risk}",
            "hold it still, and check the motor's encoder and firmware",
            kind="encoder",
            recovery=(call,),
            t=self._drive.clock.now(),
            axis=axis,
        )

    def note_loads(self) -> None:
        """Remember how far the goals of driven handles at rest are ahead of them.

        That is what their loads need; it is 0 within a step and a half.
        """
        self._loads = [None] * len(self._samples)
        for i, (samples, step) in enumerate(zip(self._samples, self._drive.step_rad, strict=True)):
            places = sorted(sample.at for sample in samples)
            resting = len(places) == KEPT and places[-1] - places[0] <= 1.5 * step
            if not resting or any(sample.goal != samples[-1].goal for sample in samples):
                continue
            at = places[KEPT // 2]
            ahead = samples[-1].goal - at
            if 1.5 * step < abs(ahead) <= LOAD_RAD:
                self._loads[i] = at, ahead

    def starting(self, position: Sequence[float]) -> tuple[float, ...]:
        """Return the goals at which handles stay as torque comes on [rad].

        Where a handle still is where it rested under a load, the goal is ahead of it by what that
        load needed; elsewhere it is the position.

        Args:
            position: confirmed positions [rad].
        """
        goal = list(position)
        for i, load in enumerate(self._loads):
            if load is not None and abs(position[i] - load[0]) <= LOAD_RAD:
                goal[i] += load[1]
        return tuple(goal)

    def stopping(
        self, goal: Sequence[float] | None, near_rad: float = LOAD_RAD
    ) -> tuple[float | None, ...]:
        """Measure, and return the goals at which handles stop that are on their way [rad].

        None for a handle that keeps the goal that its motor has: where it is near it, where it
        answers fewer than `NEEDED` of `KEPT` requests, and where its readings do not confirm each
        other or are further from the last than the speed limit allows.

        Args:
            goal: the goals in force [rad]; None if they are not known.
            near_rad: largest distance from its goal at which a handle keeps it [rad].

        Raises:
            HardwareError: of the drive.
        """
        heard = [0] * len(self._samples)
        sure = [True] * len(self._samples)
        for n in range(1, KEPT + 1):
            reading = self._drive.measure()
            for i, axis in enumerate(self._drive.axes):
                if reading.heard(axis):
                    heard[i] += 1
                    ahead = None if goal is None else goal[i]
                    sure[i] = sure[i] and self._plausible(i, reading, ahead)
            self.accept(reading)
            if min(heard) >= NEEDED or n - max(heard) > KEPT - NEEDED:
                break
        found = list(self._confirmed())
        for i, at in enumerate(found):
            near = at is not None and goal is not None and abs(at - goal[i]) <= near_rad
            if near or not sure[i] or heard[i] < NEEDED:
                found[i] = None
        return tuple(found)

    def _confirmed(self) -> tuple[float | None, ...]:
        """Return the confirmed position of each axis [rad]; None where there is none."""
        speeds = self._drive.limits.velocity_rad_s
        rows = zip(self._samples, speeds, self._drive.step_rad, strict=True)
        return tuple(confirmed(samples, speed, step) for samples, speed, step in rows)

    def _plausible(self, i: int, reading: Reading, goal: float | None) -> bool:
        """Return whether a driven handle can be where a reading says.

        It can be as far from its last two positions as its speed and a load allow, and on its way
        from there to its goal.
        """
        samples, speed = self._samples[i], self._drive.limits.velocity_rad_s[i]
        low, high = (inf, -inf) if goal is None else (goal, goal)
        for n in range(max(0, len(samples) - 2), len(samples)):
            sample = samples[n]
            reach = speed * max(0.0, reading.t - sample.t)
            low, high = min(low, sample.at - reach), max(high, sample.at + reach)
        return low - LOAD_RAD <= reading.position[i] <= high + LOAD_RAD or not samples
