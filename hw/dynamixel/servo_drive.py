"""Two servos on the handle wheels, as a guard drives them: goals in, readings out, faults told.

The same for a bus and for servos without one. Every cycle reads one block of each motor, gathered
by its indirect addresses, and believes it only if it was taken in this cycle: the device's own
clock must be as far on as ours, and the goal in it tells whether ours arrived.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import inf
from typing import Any

from endolock.hw.api import Clock, DeviceFault, HardwareError, Limits, LinkLost
from endolock.hw.drive import Reading
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel import servo_setup
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.registers import Block, Register, Units
from endolock.hw.dynamixel.servo_setup import Link
from endolock.hw.errors import RESUME, add_second
from endolock.hw.lifecycle import close_after, close_all

WATCHDOG_S = 0.4
"""Without a packet for this time [s] a motor stops where it is, by itself. Assumed: twice the time
that a command is valid, so that the guard's own hold comes first."""
STALE_S = 0.003
"""A block whose clock is this far behind the request [s] belongs to an earlier one. Assumed: two
ticks and some."""
CLOSE_S = 1.0
"""A line that is silent when it is closed is asked again for this long [s]. Assumed."""
AHEAD_S = 0.05
"""A clock that is so far ahead [s] is that of a motor that restarted. Assumed."""
DRIFT = 0.02
"""The device's clock may run off by this share of time [1]. Assumed."""
_FIRST_GATHERED = Register(reg.INDIRECT_ADDRESS.address, 2)
_PERIOD_S = 1e-3 * reg.TICK_PERIOD


class ServoDrive:
    """Drives one servo for each axis; see `hw.drive.Drive`.

    Args:
        link: leads to the servos.
        clock: stamps the readings.
        handles: how each servo sits on its wheel, by axis.
        units: what their registers count in; the X series' if None.
        watchdog_s: see `WATCHDOG_S`; a whole number of 20 ms.
    """

    def __init__(
        self,
        link: Link,
        clock: Clock,
        handles: Mapping[str, Handle],
        units: Units | None = None,
        watchdog_s: float = WATCHDOG_S,
    ) -> None:
        self.axes = tuple(handles)
        self.clock = clock
        self._link, self._handles = link, tuple(handles.values())
        self._units = units or Units()
        self._step = tuple(h.unit_rad(self._units.position_rad) for h in self._handles)
        self._watchdog = round(watchdog_s / reg.WATCHDOG_UNIT_S)
        self._zeros: list[int | None] = [handle.zero_counts for handle in self._handles]
        self._calibrated = list(self._zeros)  # what the handles' ranges are counted from
        self.limits = self._limited()
        count = len(self._handles)
        self._blocks: list[Block | None] = [None] * count
        self._known: list[int | None] = [None] * count  # positions by which whole turns are known
        self._offset = [inf] * count  # clock time at which the device's tick was 0
        self._heard = [0.0] * count
        self._refused = [False] * count
        self._sent: list[int] | None = None
        self._on = False
        self._measured = (clock.now(), 0.0)  # when, and how surely

    def describe(self) -> dict[str, Any]:
        """Return how the motors are driven as plain values, with the zeros in force."""
        rows = zip(self.axes, self._handles, self._zeros, strict=True)
        return {
            "watchdog_s": self._watchdog * reg.WATCHDOG_UNIT_S,
            "units": asdict(self._units),
            "handle": {a: {**h.model_dump(), "zero_counts": z} for a, h, z in rows},
        }

    def open(self) -> None:
        """Get hold of the motors, torque off, everything set that a cycle relies on.

        Raises:
            HardwareError: one is missing, or cannot be used as it is.
            DeviceFault: one has a latched hardware error.
        """
        self._link.open()
        try:
            self._set_up()
        except DeviceFault:
            raise
        except BaseException as error:
            close_after(error, self._link.close)
            raise

    def recover(self) -> None:
        """Get hold of the motors again after a fault, torque off; restart those with an error.

        Raises:
            HardwareError: that fails.
        """
        self._link.open()
        for axis, handle in zip(self.axes, self._handles, strict=True):
            self._link.ping(handle.id)
            if self._link.read(handle.id, reg.HARDWARE_ERROR):
                self._link.reboot(handle.id)
                servo_setup.await_restart(self._link, self.clock, axis, handle.id)
        self._set_up()

    def transfer(self, goal: tuple[float, ...] | None) -> Reading:
        """Send a goal [rad], or none, and measure.

        Raises:
            DeviceFault: a motor stopped.
            PortGone: the port was unplugged.
        """
        self._sent = None if goal is None else self._counts(goal)
        fresh, reading = self._cycle(self._sent)
        for place, block in enumerate(self._blocks):
            if block is not None and fresh[place]:
                self._known[place] = block.position
                self._check(place, block)
            elif self._refused[place]:
                self._examine(place)
        return reading

    def quantise(self, goal: tuple[float, ...]) -> tuple[float, ...]:
        """Return the nearest goal that the motors can hold [rad]."""
        return self.angles(self._counts(goal))

    def hold(self) -> tuple[float, ...] | None:
        """Stop every motor that still listens where it is, whatever is wrong with the others.

        Returns:
            Where they hold [rad]; None where nobody answered.
        """
        fresh, _ = self._cycle(None)
        known = [block for block in self._blocks if block is not None]
        if not any(fresh) or len(known) < len(fresh):
            return None
        places = [
            block.position if heard else block.goal
            for block, heard in zip(known, fresh, strict=True)
        ]
        self._cycle(places)
        return self.angles(places)

    def torque(self, on: bool) -> None:
        """Switch torque; it comes on only where the goal has arrived, the watchdog last.

        Raises:
            HardwareError: a motor refused, or does not answer.
        """
        if not on:
            self._switch_off()
            return
        assert self._sent is not None  # a guard sends the goal first; here it is made sure of
        for place, (handle, goal) in enumerate(zip(self._handles, self._sent, strict=True)):
            self._examine(place)
            self._link.write(handle.id, reg.GOAL_POSITION, goal)
        try:
            for handle in self._handles:
                self._link.write(handle.id, reg.TORQUE_ENABLE, 1)
            for handle in self._handles:
                self._link.write(handle.id, reg.WATCHDOG, self._watchdog)
        except HardwareError as error:
            try:
                self._switch_off()
            except HardwareError as second:
                add_second(error, "and torque could not be switched off again", second)
            raise
        self._on = True

    def zero(self) -> None:
        """Make the present position the zero of every axis.

        Raises:
            LinkLost: a motor does not answer.
        """
        fresh, _ = self._cycle(None)
        if not all(fresh):
            raise LinkLost(
                f"handle motor {self._name(fresh.index(False))} does not answer, so its zero is "
                "not known",
                "check cable and power",
                recovery=("home",),
                t=self.clock.now(),
                axis=self.axes[fresh.index(False)],
            )
        self._zeros = [block.position if block else None for block in self._blocks]
        self.limits = self._limited()

    def close(self) -> None:
        """Torque off, let go of the port; a silent line is asked again for `CLOSE_S`.

        Raises:
            HardwareError: a motor could not be told; its watchdog holds it.
        """
        close_all(self._relax, self._link.close)

    def _relax(self) -> None:
        """Switch torque off; try again for `CLOSE_S` while the line is silent."""
        end = self.clock.now() + CLOSE_S
        while True:
            try:
                self._switch_off()
                return
            except LinkLost:
                if self.clock.now() >= end:
                    raise
            self.clock.sleep_until(self.clock.now() + 0.05)

    def _switch_off(self) -> None:
        """Switch the torque of all motors off, and see that it is.

        The watchdog goes last: while torque is on it is the last guard.
        """
        self._on = False
        failed: list[HardwareError] = []
        for handle in self._handles:
            try:
                self._link.write(handle.id, reg.TORQUE_ENABLE, 0)
                self._link.write(handle.id, reg.WATCHDOG, 0)
            except HardwareError as error:  # the others are still to be switched off
                failed.append(error)
        if failed:
            raise failed[0]
        for place, handle in enumerate(self._handles):
            # An answer has no number: it may have been that to something older.
            if self._link.read(handle.id, reg.TORQUE_ENABLE):
                raise self._still_on(place)

    def _set_up(self) -> None:
        """Bring all motors into the state that a cycle relies on; torque off."""
        self._switch_off()
        for axis, handle in zip(self.axes, self._handles, strict=True):
            servo_setup.prepare(self._link, self.clock, axis, handle, self._units)
        self._offset = [inf] * len(self._handles)
        fresh, _ = self._cycle(None)
        for place, block in enumerate(self._blocks):
            if block is not None and fresh[place]:
                self._keep_zero(place, block.position)
        for place, block in enumerate(self._blocks):
            if block is None or not fresh[place]:
                raise LinkLost(
                    f"handle motor {self._name(place)} does not answer to a sync read",
                    "set its status return level to 2",
                    recovery=("connect",),
                    t=self.clock.now(),
                    axis=self.axes[place],
                )
            self._check(place, block)

    def _cycle(self, goals: Sequence[int] | None) -> tuple[list[bool], Reading]:
        """Do one cycle; tell who answered, and what is known then."""
        self._refused = [False] * len(self._handles)
        found, sent_at, done_at = self._link.cycle(goals, self._accept)
        fresh = [data is not None for data in found]
        if all(fresh):
            self._measured = (sent_at + done_at) / 2, (done_at - sent_at) / 2
        return fresh, self._reading(fresh, *self._measured)

    def _accept(self, place: int, data: bytes, sent_at: float, now: float) -> bool:
        """Judge a block; keep it if it was taken in this cycle and its motor did not restart."""
        block = reg.unpack(data)
        if self._offset[place] == inf:
            self._offset[place], self._heard[place] = now - 1e-3 * block.tick, now
        # What the answer took on its way, beyond the fastest one so far.
        behind = now - self._offset[place] - 1e-3 * block.tick
        behind -= _PERIOD_S * round(behind / _PERIOD_S)
        drift = DRIFT * (now - self._heard[place])
        in_time = now - behind >= sent_at - STALE_S - drift and behind > -AHEAD_S - drift
        lost_torque = self._on and not block.torque and not block.hardware_error
        blank = not any(data)  # gathered from nowhere
        if lost_torque or blank or not in_time:
            self._refused[place] = True
            return False
        self._offset[place] += min(drift, behind)
        self._blocks[place], self._heard[place] = block, now
        return True

    def _reading(self, fresh: list[bool], t: float, t_err: float) -> Reading:
        blocks = [block or _NOTHING for block in self._blocks]
        units = self._units
        signs = [handle.direction / handle.ratio for handle in self._handles]
        speeds = zip(blocks, signs, strict=True)
        currents = zip(blocks, self._handles, strict=True)
        tick = blocks[0].tick
        if self._offset[0] != inf:
            period = reg.TICK_PERIOD
            tick += period * round((1e3 * (t - self._offset[0]) - tick) / period)
        return Reading(
            t=t,
            t_err=t_err,
            position=self.angles([block.position for block in blocks]),
            velocity=tuple(b.velocity * units.velocity_rad_s * s for b, s in speeds),
            current=tuple(b.current * units.current_a * h.direction for b, h in currents),
            fresh=all(fresh),
            device_tick=tick,
            goal=self.angles([block.goal for block in blocks]),
            silent=tuple(a for a, f in zip(self.axes, fresh, strict=True) if not f),
        )

    def _check(self, place: int, block: Block) -> None:
        """Raise what a block tells of its motor."""
        tripped = self._on and block.watchdog == reg.TRIPPED
        if not block.hardware_error and not tripped and bool(block.torque) == self._on:
            return
        name, axis, now = self._name(place), self.axes[place], self.clock.now()
        known = [told for bit, told in reg.HARDWARE_ERRORS.items() if block.hardware_error & bit]
        if block.hardware_error:
            unknown = f"hardware error {block.hardware_error:#04x}", "see its maker's manual"
            kind, what, first = known[0] if known else ("reset", *unknown)
            raise DeviceFault(
                f"handle motor {name} stopped: {what}",
                first,
                kind=kind,
                recovery=RESUME,
                t=now,
                axis=axis,
            )
        if tripped:
            raise DeviceFault(
                f"handle motor {name} stopped by itself: it received no packet "
                f"for {self._watchdog * reg.WATCHDOG_UNIT_S:g} s; it holds where it is",
                "find out what delayed the program",
                kind="watchdog",
                recovery=RESUME,
                t=now,
                axis=axis,
            )
        if block.torque:
            raise self._still_on(place)

    def _still_on(self, place: int) -> LinkLost:
        return LinkLost(
            f"handle motor {self._name(place)} has torque though it was switched off",
            "end any other program that drives it",
            recovery=("clear_fault",),
            t=self.clock.now(),
            axis=self.axes[place],
        )

    def _examine(self, place: int) -> None:
        """Ask a motor whose blocks are not believed what has become of it."""
        device = self._handles[place].id
        try:
            # A restart makes it forget what its block is made of.
            restarted = self._link.read(device, _FIRST_GATHERED) != reg.BLOCK_ADDRESSES[0]
            switched_off = self._on and not self._link.read(device, reg.TORQUE_ENABLE)
        except LinkLost:
            return  # silent: its age tells
        if restarted or switched_off:
            what = "has restarted: its power was off for a moment, or somebody rebooted it"
            if not restarted:
                what = "was switched off by somebody else"
            raise DeviceFault(
                f"handle motor {self._name(place)} {what}",
                "check plug and supply",
                kind="reset",
                recovery=RESUME,
                t=self.clock.now(),
                axis=self.axes[place],
            )

    def _keep_zero(self, place: int, position: int) -> None:
        """Know the zero where none is given, and count turns so that it is the nearest one.

        A motor forgets whole turns when it starts; after a restart it stands where it last did.
        """
        zero, calibrated = self._zeros[place], self._calibrated[place]
        known = self._known[place]
        self._known[place] = position
        if zero is None or calibrated is None:
            self._zeros[place] = self._calibrated[place] = position
            return
        turned = reg.TURN * round((position - (zero if known is None else known)) / reg.TURN)
        self._zeros[place], self._calibrated[place] = zero + turned, calibrated + turned

    def _limited(self) -> Limits:
        """What may be asked for, counted from the present zeros."""
        counted = zip(self._zeros, self._calibrated, self._step, strict=True)
        moved = [((zero or 0) - (calibrated or 0)) * step for zero, calibrated, step in counted]
        rows = list(zip(self._handles, moved, strict=True))
        return Limits(
            position_rad=tuple((h.range_rad[0] - m, h.range_rad[1] - m) for h, m in rows),
            velocity_rad_s=tuple(h.speed_rad_s for h in self._handles),
        )

    def _counts(self, goal: tuple[float, ...]) -> list[int]:
        rows = zip(goal, self._step, self._zeros, strict=True)
        return [round(angle / step) + (zero or 0) for angle, step, zero in rows]

    def angles(self, counts: Sequence[int]) -> tuple[float, ...]:
        """Return the handle angles at positions of the motors [rad]."""
        rows = zip(counts, self._step, self._zeros, strict=True)
        return tuple((count - (zero or 0)) * step for count, step, zero in rows)

    def _name(self, place: int) -> str:
        return f"{self._handles[place].id} ({self.axes[place]})"


_NOTHING = Block(0, 0, 0, 0, 0, 0, 0, 0)
