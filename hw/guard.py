"""Wraps every handle drive and makes it a safe `Actuators`.

A drive only transfers goals and measurements. Modes, limits, slew rate, refusal of NaN, expiry of
commands, following error and latched faults are handled here, once, so that a simulated run
exercises the same safety code as a bench. Laboratory software, not a medical device.
"""

from __future__ import annotations

from dataclasses import replace

from endolock.hw import guard_checks
from endolock.hw.api import (
    Clock,
    Command,
    DeviceFault,
    HardwareError,
    Limits,
    Mode,
    State,
    StateError,
)
from endolock.hw.drive import Drive, Reading
from endolock.hw.errors import RESUME, add_second
from endolock.hw.guard_checks import Checks
from endolock.hw.guard_checks import GuardSettings as GuardSettings
from endolock.hw.history import History
from endolock.hw.lifecycle import Connecting
from endolock.hw.positions import LOAD_RAD, Positions


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
        self._expires = self._slewed_at = 0.0
        self._checks = Checks(drive.axes, self._settings)
        self._positions = Positions(drive)
        self._stop: str | None = None
        self._seq = 0

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
            self._positions.forget()
            self._checks.restart(self.clock.now())

    def home(self) -> None:
        """Make the present position the zero of both axes; see `Actuators.home`."""
        if self._mode is not Mode.DISABLED:
            first = {Mode.DISCONNECTED: "connect", Mode.FAULT: "clear_fault"}
            raise self._state_error(
                f"cannot home while {self._mode}", first.get(self._mode, "disable")
            )
        _, position = self._confirm("home", "the zeros are not known")
        self._drive.zero(position)
        self._history = History()  # the old one counts from the old zero
        self._positions.forget()

    def enable(self) -> State:
        """Switch torque on without a jump; see `Actuators.enable`."""
        if self._mode is Mode.DISCONNECTED:
            raise self._state_error(f"cannot enable while {self._mode}", "connect")
        if (why := self._fault or self._stopped(self.clock.now())) is not None:
            raise self._state_error(f"cannot enable: {why.what}", "clear_fault", why.next_step)
        reading, position = self._confirm("enable", "enabling could make them jump")
        goal = self._drive.quantise(self._positions.starting(position))
        self._goal = self._limited = self._commanded = goal
        try:
            # The goal is written before torque comes on.
            self._drive.transfer(goal)
            self._drive.torque(True)
        except HardwareError as fault:
            self._latch(fault)
            raise
        self._slewed_at = self._expires = now = self.clock.now()
        self._checks.restart(now)
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
            self._checks.age(reading, now)
            if driven:
                reading = self._check_driven(reading, now)
            else:
                self._positions.accept(reading)
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
        if self._mode.driven:
            self._positions.note_loads()
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
        self._checks.restart(self.clock.now())

    def close(self) -> None:
        """Switch torque off and release the drive; may be called twice."""
        if self._mode is not Mode.DISCONNECTED:
            self._mode = Mode.DISCONNECTED
            self._drive.close()

    def _accept(self, command: Command, now: float) -> None:
        if not self._mode.driven:
            raise self._state_error(f"cannot move while {self._mode}", "enable")
        position = guard_checks.values(command, self.axes, now)
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
        if self._checks.waiting(now):
            step = 0.0
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

    def _check_driven(self, reading: Reading, now: float) -> Reading:
        """Check a reading of driven handles; return what is believed of it."""
        sent = self._drive.quantise(self._goal)
        believed = self._positions.believe(reading, sent)
        self._checks.following(believed, self._goal, now)
        self._checks.taken(reading, sent, now)
        return believed

    def _confirm(self, call: str, risk: str) -> tuple[Reading, tuple[float, ...]]:
        """Return a reading and the confirmed positions [rad]; see `Positions.confirm`."""
        try:
            return self._positions.confirm(call, risk)
        except HardwareError as fault:
            if fault.recovery != (call,):  # else nothing has happened but that it is not known
                self._latch(fault)
            raise

    def _latch(self, fault: HardwareError) -> None:
        """Latch the first fault and hold."""
        driven = self._mode.driven
        if driven:
            self._positions.note_loads()
        self._fault = self._fault or fault
        self._mode = Mode.FAULT
        try:
            # Where a handle is blocked, none is pushed, not even as far as a load would need.
            blocked = isinstance(fault, DeviceFault) and fault.kind == "following"
            near_rad = 0.0 if blocked else LOAD_RAD
            goal = self._positions.stopping(self._goal if driven else None, near_rad)
            if any(at is not None for at in goal):
                self._drive.hold(goal)
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
