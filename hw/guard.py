"""Wraps every handle drive and makes it a safe `Actuators`.

A drive only transfers goals and measurements. Modes, limits, slew rate, refusal of NaN, expiry of
commands, following error and latched faults are handled here, once, so that a simulated run
exercises the same safety code as a bench. Laboratory software, not a medical device.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, isfinite

from endolock.hw.api import (
    Clock,
    Command,
    CommandError,
    DeviceFault,
    HardwareError,
    Limits,
    LinkLost,
    Mode,
    State,
    StateError,
)
from endolock.hw.drive import Drive, Reading
from endolock.hw.errors import RESUME, add_second
from endolock.hw.history import History
from endolock.hw.lifecycle import Connecting


@dataclass(frozen=True, kw_only=True)
class GuardSettings:
    """Thresholds of a guard."""

    following_error_rad: float = 0.5
    """Largest distance of a handle from its goal [rad]. Assumed: at full speed a servo lags by
    0.1 rad, and a blocked handle is off by 0.5 rad after 0.15 s."""
    following_time_s: float = 0.2
    """A larger distance for longer than this [s] is a fault. Assumed."""
    max_age_s: float = 0.1
    """The link counts as lost after this time without a fresh state [s]. Assumed."""
    max_slew_step_s: float = 0.1
    """After a pause the goal moves at most as far as it may within this time [s]. Assumed."""


class Guard(Connecting):
    """Actuators made of a drive and the rules of safe motion.

    Args:
        drive: moves the handles.
        settings: thresholds; the defaults if None.
    """

    def __init__(self, drive: Drive, settings: GuardSettings | None = None) -> None:
        self._drive = drive
        self._settings = settings or GuardSettings()
        self._history = History()
        self._mode = Mode.DISCONNECTED
        self._fault: HardwareError | None = None
        # The position commanded, the same within the limits, and the goal on its way there.
        self._commanded: tuple[float, ...] = ()
        self._limited: tuple[float, ...] = ()
        self._goal: tuple[float, ...] = ()
        self._expires = self._slewed_at = self._fresh_at = self._taken_at = 0.0
        self._stop: str | None = None
        self._off_since: list[float | None] = [None] * len(drive.axes)
        self._seq = self._unanswered = 0

    @property
    def clock(self) -> Clock:
        """The clock that stamps the states."""
        return self._drive.clock

    @property
    def axes(self) -> tuple[str, ...]:
        """Axis names, in the order of every tuple here."""
        return self._drive.axes

    @property
    def limits(self) -> Limits:
        """Limits of position and speed, counted from the present zero."""
        return self._drive.limits

    @property
    def mode(self) -> Mode:
        """Present mode."""
        return self._mode

    def connect(self) -> None:
        """Open the drive; afterwards the mode is DISABLED. Without effect where it is open.

        A device with a fault of its own is connected as well; the mode is then FAULT.
        """
        if self._mode is Mode.DISCONNECTED:
            try:
                self._drive.open()
            except DeviceFault as fault:
                self._fault = fault
            self._mode = Mode.FAULT if self._fault else Mode.DISABLED
            self._fresh_at = self.clock.now()

    def home(self) -> None:
        """Make the present position the zero of both axes; see `Actuators.home`."""
        if self._mode is not Mode.DISABLED:
            first = {Mode.DISCONNECTED: "connect", Mode.FAULT: "clear_fault"}
            raise self._state_error(
                f"cannot home while {self._mode}", first.get(self._mode, "disable")
            )
        self._drive.zero()
        self._history = History()  # the old one counts from the old zero

    def enable(self) -> State:
        """Switch torque on without a jump; see `Actuators.enable`."""
        if self._mode is Mode.DISCONNECTED:
            raise self._state_error(f"cannot enable while {self._mode}", "connect")
        now = self.clock.now()
        if (why := self._fault or self._stopped(now)) is not None:
            raise self._state_error(f"cannot enable: {why.what}", "clear_fault", why.next_step)
        try:
            reading = self._drive.transfer(None)
            if reading.fresh:
                self._goal = self._limited = self._commanded = self._drive.quantise(
                    reading.position
                )
                # The goal is written before torque comes on.
                self._drive.transfer(self._goal)
                self._drive.torque(True)
        except HardwareError as fault:
            self._latch(fault)
            raise
        if not reading.fresh:  # nothing was sent, so there is nothing to latch
            raise LinkLost(
                "the handles do not answer, so enabling could make them jump",
                "check cable and power",
                recovery=("enable",),
                t=now,
            )
        self._slewed_at = self._fresh_at = self._taken_at = self._expires = now
        self._off_since = [None] * len(self.axes)
        self._mode = Mode.HOLDING
        return self._remember(replace(reading, goal=self._goal), (0,) * len(self.axes))

    def exchange(self, command: Command | None) -> State:
        """Send a command and read the state; see `Actuators.exchange`."""
        if self._mode is Mode.DISCONNECTED:
            raise self._state_error(f"cannot exchange while {self._mode}", "connect")
        if self._fault is not None:
            raise self._fault
        now = self.clock.now()
        if (stopped := self._stopped(now)) is not None:
            self._latch(stopped)
            raise stopped
        if command is not None:
            self._accept(command, now)
        elif self._mode is Mode.ENABLED and now > self._expires:
            self._freeze()
        driven = self._mode.driven
        clipped = self._slew(now) if driven else (0,) * len(self.axes)
        try:
            reading = self._drive.transfer(self._goal if driven else None)
            self._check_age(reading, now)
            if driven:
                self._check_following(reading, now)
                self._check_taken(reading, now)
        except HardwareError as fault:
            self._latch(fault)
            raise
        return self._remember(reading, clipped)

    def history(self, t: float) -> State:
        """Return the state at a past time; see `Actuators.history`."""
        return self._history.at(t)

    def hold(self) -> None:
        """Stop where the handles are and keep torque on; without effect where torque is off."""
        if self._mode is Mode.ENABLED:
            self._freeze()

    def estop(self, why: str) -> None:
        """Stop and latch a fault; see `Actuators.estop`."""
        self._stop = why

    def disable(self) -> None:
        """Switch torque off; see `Actuators.disable`."""
        if self._mode is Mode.DISCONNECTED:
            return
        try:
            self._drive.torque(False)
        except HardwareError as fault:
            self._latch(fault)
            raise
        self._mode = Mode.FAULT if self._fault else Mode.DISABLED

    def clear_fault(self) -> None:
        """Clear a latched fault; see `Actuators.clear_fault`."""
        self._stop = None
        if self._fault is None:
            return
        if self._mode is not Mode.DISCONNECTED:
            self._drive.recover()
            self._mode = Mode.DISABLED
        self._fault = None
        self._fresh_at = self.clock.now()

    def close(self) -> None:
        """Switch torque off and release the drive; may be called twice."""
        if self._mode is not Mode.DISCONNECTED:
            self._mode = Mode.DISCONNECTED
            self._drive.close()

    def _accept(self, command: Command, now: float) -> None:
        if not self._mode.driven:
            raise self._state_error(f"cannot move while {self._mode}", "enable")
        position = tuple(float(p) for p in command.position)
        if len(position) != len(self.axes):
            raise CommandError(
                f"command has {len(position)} positions",
                f"give {len(self.axes)}: {', '.join(self.axes)}",
                t=now,
            )
        for axis, value in zip(self.axes, position, strict=True):
            if not isfinite(value):
                raise CommandError(
                    f"command for {axis} is {value}",
                    "give a finite angle in rad (the previous goal stays)",
                    t=now,
                    axis=axis,
                )
        if not 0 < command.valid_for < inf:
            raise CommandError(
                f"command is valid for {command.valid_for} s",
                "give a finite time of more than 0 (the previous goal stays)",
                t=now,
            )
        self._commanded = position
        self._limited = tuple(
            min(max(p, low), high)
            for p, (low, high) in zip(position, self.limits.position_rad, strict=True)
        )
        self._expires = now + command.valid_for
        self._mode = Mode.ENABLED

    def _slew(self, now: float) -> tuple[int, ...]:
        """Move the goal towards the limited command as fast as allowed; return `State.clipped`."""
        step = min(now - self._slewed_at, self._settings.max_slew_step_s)
        self._slewed_at = now
        moved = []
        for goal, limited, speed in zip(
            self._goal, self._limited, self.limits.velocity_rad_s, strict=True
        ):
            reach = speed * step
            moved.append(min(max(limited, goal - reach), goal + reach))
        # The goal continues from the unrounded value: rounding must not suppress slow motion.
        self._goal = tuple(moved)
        return tuple((a > g) - (a < g) for a, g in zip(self._commanded, self._goal, strict=True))

    def _freeze(self) -> None:
        self._limited = self._commanded = self._goal
        self._mode = Mode.HOLDING

    def _check_age(self, reading: Reading, now: float) -> None:
        self._unanswered = 0 if reading.fresh else self._unanswered + 1
        if reading.fresh:
            self._fresh_at = now
        # A single missing answer is no loss, however long ago the one before was.
        elif self._unanswered > 1 and now - self._fresh_at > self._settings.max_age_s:
            who = " and ".join(reading.silent) or "the handles"
            raise LinkLost(
                f"no answer from {who} for {now - self._fresh_at:.3f} s; the goal is frozen",
                "check cable and power",
                recovery=RESUME,
                t=now,
                axis=reading.silent[0] if reading.silent else None,
            )

    def _check_taken(self, reading: Reading, now: float) -> None:
        """Check that goals arrive, where the motors report theirs."""
        if reading.goal is None or reading.goal == self._drive.quantise(self._goal):
            self._taken_at = now
        elif reading.fresh and now - self._taken_at > self._settings.max_age_s:
            axis = next(
                axis
                for axis, has, sent in zip(
                    self.axes, reading.goal, self._drive.quantise(self._goal), strict=True
                )
                if has != sent
            )
            raise LinkLost(
                f"no goal reached {axis} for {now - self._taken_at:.3f} s, though it answers; the "
                "goal is frozen",
                "check the cable",
                recovery=RESUME,
                t=now,
                axis=axis,
            )

    def _check_following(self, reading: Reading, now: float) -> None:
        settings = self._settings
        for i, axis in enumerate(self.axes):
            error = self._goal[i] - reading.position[i]
            if abs(error) <= settings.following_error_rad:
                self._off_since[i] = None
                continue
            since = self._off_since[i]
            if since is None:
                self._off_since[i] = now
            elif now - since > settings.following_time_s:
                raise DeviceFault(
                    f"handle {axis} is {error:+.2f} rad from its goal for more than "
                    f"{settings.following_time_s:g} s; the goal is frozen where it stands",
                    "free the handle",
                    recovery=RESUME,
                    kind="following",
                    t=now,
                    axis=axis,
                )

    def _latch(self, fault: HardwareError) -> None:
        """Latch the first fault and hold: the goal becomes the present position."""
        self._fault = self._fault or fault
        self._mode = Mode.FAULT
        try:
            self._goal = self._drive.hold() or self._goal
        except HardwareError as second:
            add_second(fault, "the hold command failed", second)

    def _remember(self, reading: Reading, clipped: tuple[int, ...]) -> State:
        state = State(
            t=reading.t,
            t_err=reading.t_err,
            seq=self._seq,
            position=reading.position,
            velocity=reading.velocity,
            current=reading.current,
            goal=self._in_force(reading),
            clipped=clipped,
            fresh=reading.fresh,
            mode=self._mode,
            device_tick=reading.device_tick,
        )
        self._seq += 1
        self._history.append(state)
        return state

    def _in_force(self, reading: Reading) -> tuple[float, ...]:
        if not self._mode.driven:
            return reading.position
        return self._drive.quantise(self._goal) if reading.goal is None else reading.goal

    def _stopped(self, now: float) -> DeviceFault | None:
        """Return the fault that an emergency stop asks for; or None."""
        if self._stop is None:
            return None
        return DeviceFault(
            f"stopped: {self._stop}",
            "remove the cause",
            kind="estop",
            recovery=RESUME,
            t=now,
        )

    def _state_error(self, what: str, first: str, next_step: str = "") -> StateError:
        """Refuse a call that does not fit the mode.

        Args:
            what: what was refused.
            first: the call to make before it.
            next_step: what to do before that.
        """
        return StateError(what, next_step, recovery=(first,), t=self.clock.now())
