"""Two servos on the handle wheels, as a guard drives them: goals in, readings and faults out.

The same code drives servos on a bus and servos without one. Every cycle reads one block per motor,
gathered by its indirect addresses, and accepts it only if it was taken in this cycle: the device's
own clock must have advanced as far as ours. The goal in it shows whether ours arrived.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import inf
from typing import Any

from endolock.hw.api import Clock, DeviceFault, HardwareError, Limits, LinkLost, StateError
from endolock.hw.confirmed import KEPT, NEEDED, Sample, majority
from endolock.hw.drive import Reading
from endolock.hw.dynamixel import motor_faults, servo_setup
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.motor_faults import Who
from endolock.hw.dynamixel.registers import Block, Register, Units
from endolock.hw.dynamixel.servo_bus import TRIES
from endolock.hw.dynamixel.servo_setup import Identity, Link, Prepared
from endolock.hw.dynamixel.zeros import Zeros
from endolock.hw.errors import add_second
from endolock.hw.lifecycle import close_after, close_all

WATCHDOG_S = 0.4
"""A motor stops by itself after this time without a packet [s]. Assumed: twice the time that a
command is valid, so that the guard's own hold comes first."""
STALE_S = 0.003
"""A block whose clock is behind the request by more than this answers an earlier one [s]. Assumed:
two ticks, and some more."""
CLOSE_S = 1.0
"""On closing, a silent line is retried for this time [s]. Assumed."""
AHEAD_S = 0.05
"""A clock that is ahead by more than this means that the motor has restarted [s]. Assumed."""
DRIFT = 0.02
"""Largest relative error of the device's clock [1]. Assumed."""
_FIRST_GATHERED = Register(reg.INDIRECT_ADDRESS.address, 2)
_PERIOD_S = 1e-3 * reg.TICK_PERIOD


class ServoDrive:
    """Drives one servo for each axis; see `hw.drive.Drive`.

    Args:
        link: connects to the servos.
        clock: stamps the readings.
        handles: how each servo drives its wheel, by axis.
        units: units of their registers; those of each motor's model if None.
        watchdog_s: see `WATCHDOG_S`; a multiple of 20 ms.
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
        self._link, self._by_axis, self._handles = link, dict(handles), tuple(handles.values())
        self._given_units = units
        self._units = tuple(units or Units() for _ in self._handles)
        self._motors: tuple[Prepared, ...] = ()
        self._watchdog = round(watchdog_s / reg.WATCHDOG_UNIT_S)
        self._zeros = Zeros(self._handles)
        self._count()
        count = len(self._handles)
        self._blocks: list[Block | None] = [None] * count
        self._offset = [inf] * count  # clock time at which the device's tick was 0
        self._heard = [0.0] * count
        self._refused = [False] * count
        self._sent: list[int] | None = None
        self._on = False
        self._measured = (clock.now(), 0.0)  # when, and how surely

    @property
    def limits(self) -> Limits:
        """Limits of position and speed, counted from the present zeros."""
        return self._zeros.limits

    @property
    def step_rad(self) -> tuple[float, ...]:
        """Handle angle of one step of the encoder of each axis [rad]."""
        return tuple(abs(step) for step in self._zeros.step)

    def describe(self) -> dict[str, Any]:
        """Return the settings of the drive as plain values, with the present zeros.

        Once it is open, `motor` holds the registers of each motor; `units` are those of the first.
        """
        rows = zip(self.axes, self._handles, self._zeros.counts, strict=True)
        motors = zip(self.axes, self._motors, strict=False)  # none before it is open
        return {
            "watchdog_s": self._watchdog * reg.WATCHDOG_UNIT_S,
            "units": asdict(self._units[0]),
            "handle": {a: {**h.model_dump(), "zero_counts": z} for a, h, z in rows},
            "motor": {axis: asdict(motor) for axis, motor in motors},
        }

    def open(self) -> None:
        """Open the motors, torque off, and set everything that a cycle relies on.

        Raises:
            HardwareError: one is missing, or cannot be used as it is set.
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
        """Reopen the motors after a fault, torque off; restart those with a hardware error.

        Raises:
            HardwareError: that fails.
        """
        self._link.open()
        self._identify()
        for axis, handle in zip(self.axes, self._handles, strict=True):
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
        self._sent = None if goal is None else self._zeros.to_counts(goal)
        fresh, reading = self._cycle(self._sent)
        for index, block in enumerate(self._blocks):
            if block is not None and fresh[index]:
                self._zeros.saw(index, block.position)
                self._check(index, block)
            elif self._refused[index]:
                self._examine(index)
        return reading

    def quantise(self, goal: tuple[float, ...]) -> tuple[float, ...]:
        """Return the nearest goal that the motors can represent [rad]."""
        return self.angles(self._zeros.to_counts(goal))

    def measure(self) -> Reading:
        """Measure, whatever state the motors are in.

        Raises:
            PortGone: the port was unplugged.
        """
        return self._cycle(None)[1]

    def hold(self, goal: tuple[float | None, ...]) -> None:
        """Send a goal [rad] to every motor that still responds; with None it keeps its goal.

        Goals are not acknowledged: it is sent until the blocks show it, `TRIES` times at most.

        Raises:
            PortGone: the port was unplugged.
        """
        counts = self._zeros.to_counts([at or 0.0 for at in goal])
        goals = [None if g is None else c for g, c in zip(goal, counts, strict=True)]
        for _ in range(TRIES):
            fresh, _ = self._cycle(goals)
            rows = zip(goals, self._blocks, fresh, strict=True)
            if all(g is None or (f and b is not None and b.goal == g) for g, b, f in rows):
                return

    def torque(self, on: bool) -> None:
        """Switch torque on or off; on only after the goal has arrived, with the watchdog last.

        Raises:
            StateError: no goal was sent before.
            HardwareError: a motor refused, or does not answer.
        """
        if not on:
            self._switch_off()
            return
        if self._sent is None:
            raise StateError(
                "torque cannot come on without a goal",
                "send the present positions first",
                t=self.clock.now(),
            )
        for index, (handle, goal) in enumerate(zip(self._handles, self._sent, strict=True)):
            self._examine(index)
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
                add_second(error, "torque could not be switched off again", second)
            raise
        self._on = True

    def zero(self, position: tuple[float, ...]) -> None:
        """Make this position [rad] the zero of every axis."""
        self._zeros.move(position)

    def close(self) -> None:
        """Switch torque off and close the port; a silent line is retried for `CLOSE_S`.

        Raises:
            HardwareError: a motor did not take the command; its watchdog holds it.
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
        """Switch the torque of all motors off, and check that it is.

        The watchdog is switched off last: while torque is on it is the last protection.
        """
        self._on = False
        failed: list[HardwareError] = []
        for handle in self._handles:
            try:
                self._link.write(handle.id, reg.TORQUE_ENABLE, 0)
                self._link.write(handle.id, reg.WATCHDOG, 0)
            except HardwareError as error:  # the others still have to be switched off
                failed.append(error)
        if failed:
            raise failed[0]
        for index, handle in enumerate(self._handles):
            # Answers have no number: this one may have been to an older request.
            if self._link.read(handle.id, reg.TORQUE_ENABLE):
                raise motor_faults.still_on(self._who(index))

    def _set_up(self) -> None:
        """Set all motors up for cycles; torque off. Nothing is written before all are known."""
        found = self._identify()
        self._switch_off()
        self._motors = tuple(
            servo_setup.prepare(self._link, self.clock, self._by_axis, found, self._given_units)
        )
        self._units = tuple(motor.units for motor in self._motors)
        self._count()
        self._offset = [inf] * len(self._handles)
        self._start()

    def _start(self) -> None:
        """Take the positions from which zeros and whole turns are counted."""
        seen: list[list[Sample]] = [[] for _ in self._handles]
        for _ in range(KEPT):
            fresh, reading = self._cycle(None)
            for samples, block, heard in zip(seen, self._blocks, fresh, strict=True):
                if block is not None and heard:
                    samples.append(Sample(reading.t, block.position))
        for index, (samples, handle) in enumerate(zip(seen, self._handles, strict=True)):
            if len(samples) < NEEDED:
                raise motor_faults.unread(self._who(index))
            speed = handle.speed_rad_s / self.step_rad[index]
            position = majority(samples, speed, 1.0)
            if position is None:
                counts = [int(sample.at) for sample in samples]
                raise motor_faults.disagreeing(self._who(index), counts)
            self._zeros.start(index, int(position))
        for index, block in enumerate(self._blocks):
            if block is not None:
                self._check(index, block)

    def _count(self) -> None:
        """Count in the units of the motors."""
        self._zeros.count([units.position_rad for units in self._units])

    def _identify(self) -> list[Identity]:
        return servo_setup.identify(self._link, self.clock, self._by_axis)

    def _cycle(self, goals: Sequence[int | None] | None) -> tuple[list[bool], Reading]:
        """Do one cycle; return which motors answered, and the reading."""
        self._refused = [False] * len(self._handles)
        found, sent_at, done_at = self._link.cycle(goals, self._accept)
        fresh = [data is not None for data in found]
        if all(fresh):
            self._measured = (sent_at + done_at) / 2, (done_at - sent_at) / 2
        return fresh, self._reading(fresh, *self._measured)

    def _accept(self, index: int, data: bytes, sent_at: float, now: float) -> bool:
        """Check a block; keep it if it was taken in this cycle and its motor did not restart."""
        block = reg.unpack(data)
        if self._offset[index] == inf:
            self._offset[index], self._heard[index] = now - 1e-3 * block.tick, now
        # Delay of the answer, relative to the fastest one so far.
        behind = now - self._offset[index] - 1e-3 * block.tick
        behind -= _PERIOD_S * round(behind / _PERIOD_S)
        drift = DRIFT * (now - self._heard[index])
        in_time = now - behind >= sent_at - STALE_S - drift and behind > -AHEAD_S - drift
        lost_torque = self._on and not block.torque and not block.hardware_error
        blank = not any(data)  # its indirect addresses are not set
        if lost_torque or blank or not in_time:
            self._refused[index] = True
            return False
        self._offset[index] += min(drift, behind)
        self._blocks[index], self._heard[index] = block, now
        return True

    def _reading(self, fresh: list[bool], t: float, t_err: float) -> Reading:
        blocks = [block or _NOTHING for block in self._blocks]
        signs = [handle.direction / handle.ratio for handle in self._handles]
        speeds = zip(blocks, self._units, signs, strict=True)
        currents = zip(blocks, self._units, self._handles, strict=True)
        tick = blocks[0].tick
        if self._offset[0] != inf:
            period = reg.TICK_PERIOD
            tick += period * round((1e3 * (t - self._offset[0]) - tick) / period)
        return Reading(
            t=t,
            t_err=t_err,
            position=self.angles([block.position for block in blocks]),
            velocity=tuple(b.velocity * u.velocity_rad_s * s for b, u, s in speeds),
            current=tuple(b.current * u.current_a * h.direction for b, u, h in currents),
            fresh=all(fresh),
            device_tick=tick,
            goal=self.angles([block.goal for block in blocks]),
            silent=tuple(a for a, f in zip(self.axes, fresh, strict=True) if not f),
        )

    def _check(self, index: int, block: Block) -> None:
        """Raise the fault that a block reports."""
        watchdog_s = self._watchdog * reg.WATCHDOG_UNIT_S
        fault = motor_faults.of_block(self._who(index), block, self._on, watchdog_s)
        if fault is not None:
            raise fault

    def _examine(self, index: int) -> None:
        """Find out why the blocks of a motor are not accepted."""
        device = self._handles[index].id
        try:
            # A restart resets the indirect addresses.
            restarted = self._link.read(device, _FIRST_GATHERED) != reg.BLOCK_ADDRESSES[0]
            switched_off = self._on and not self._link.read(device, reg.TORQUE_ENABLE)
        except LinkLost:
            return  # silent: the guard checks its age
        if restarted or switched_off:
            raise motor_faults.reset(self._who(index), restarted=restarted)

    def angles(self, counts: Sequence[int]) -> tuple[float, ...]:
        """Return the handle angles at these motor positions [rad]."""
        return self._zeros.to_angles(counts)

    def _who(self, index: int) -> Who:
        return Who(self._handles[index].id, self.axes[index], self.clock.now())


_NOTHING = Block(0, 0, 0, 0, 0, 0, 0, 0)
