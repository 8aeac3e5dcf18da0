"""Counts of motors and angles of handles: zeros, whole turns, and the limits counted from there."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from endolock.hw.api import Limits
from endolock.hw.confirmed import NEEDED
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.registers import Units


class Zeros:
    """Zeros of the handles, and where their motors were last.

    Args:
        handles: how each motor drives its wheel.
    """

    def __init__(self, handles: Sequence[Handle]) -> None:
        self._handles = tuple(handles)
        self.step = tuple(handle.unit_rad(Units().position_rad) for handle in handles)
        """Handle angle of one count, signed [rad]."""
        self.counts: list[int | None] = [handle.zero_counts for handle in handles]
        """Motor position at handle angle zero [counts]; None until it is taken."""
        self._calibrated = list(self.counts)  # what the handles' ranges are counted from
        # Positions by which whole turns are known, and the last ones read.
        self._known: list[int | None] = [None] * len(self._handles)
        self._read: tuple[deque[int], ...] = tuple(deque(maxlen=NEEDED) for _ in handles)
        self.limits = self._limited()
        """Limits of the handles, counted from the present zeros."""

    def count(self, position_rad: Sequence[float]) -> None:
        """Count in other units.

        Args:
            position_rad: motor angle of one count of each [rad].
        """
        rows = zip(self._handles, position_rad, strict=True)
        self.step = tuple(handle.unit_rad(unit) for handle, unit in rows)
        self.limits = self._limited()

    def saw(self, index: int, position: int) -> None:
        """Remember a position [counts]; one counts once its neighbours are in the same turn.

        A motor forgets whole turns when it starts, and a single reading may be wrong by one.
        """
        read = self._read[index]
        read.append(position)
        if len(read) == NEEDED and max(read) - min(read) <= reg.TURN // 4:
            self._known[index] = position

    def start(self, index: int, position: int) -> None:
        """Take a confirmed position of a motor that may have restarted, and count whole turns.

        The zero is taken there where none is given. After a restart the motor is taken to be where
        it last was, at the first start within half a turn of its zero.
        """
        zero, calibrated = self.counts[index], self._calibrated[index]
        known = self._known[index]
        self._known[index] = position
        self._read[index].clear()
        if zero is None or calibrated is None:
            self.counts[index] = self._calibrated[index] = position
        else:
            turned = reg.TURN * round((position - (zero if known is None else known)) / reg.TURN)
            self.counts[index], self._calibrated[index] = zero + turned, calibrated + turned
        self.limits = self._limited()

    def move(self, position: Sequence[float]) -> None:
        """Make these angles [rad] the zeros."""
        self.counts = list(self.to_counts(position))
        self.limits = self._limited()

    def to_counts(self, angles: Sequence[float]) -> list[int]:
        """Return the motor positions nearest to these handle angles [rad]."""
        rows = zip(angles, self.step, self.counts, strict=True)
        return [round(angle / step) + (zero or 0) for angle, step, zero in rows]

    def to_angles(self, counts: Sequence[int]) -> tuple[float, ...]:
        """Return the handle angles at these motor positions [rad]."""
        rows = zip(counts, self.step, self.counts, strict=True)
        return tuple((count - (zero or 0)) * step for count, step, zero in rows)

    def _limited(self) -> Limits:
        counted = zip(self.counts, self._calibrated, self.step, strict=True)
        moved = [((zero or 0) - (calibrated or 0)) * step for zero, calibrated, step in counted]
        rows = list(zip(self._handles, moved, strict=True))
        return Limits(
            position_rad=tuple((h.range_rad[0] - m, h.range_rad[1] - m) for h, m in rows),
            velocity_rad_s=tuple(h.speed_rad_s for h in self._handles),
        )
