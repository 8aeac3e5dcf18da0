"""Whatever is called and whatever happens, in any order: the rules of the seam hold."""

from __future__ import annotations

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from tests.hw.emulated import PERIOD_S, STEP_RAD, Emulated

from endolock.hw.api import (
    Command,
    DeviceFault,
    HardwareError,
    LinkError,
    Mode,
    State,
    StateError,
)
from endolock.hw.guard import GuardSettings

FASTEST_RAD_S = 3.49


class AnyOrder(RuleBasedStateMachine):
    """Actuators over the device model, with a hand that breaks things."""

    @initialize()
    def make(self) -> None:
        """Begin with a bench that nobody has connected."""
        self.bench = Emulated()
        self.guard = self.bench.guard
        self.state: State | None = None
        self.goals = self._goals()
        self.moved_at = self.bench.clock.now()

    @rule()
    def connect(self) -> None:
        """Connect; refused only where there is nothing to connect to."""
        try:
            self.guard.connect()
        except LinkError:
            assert not self.bench.port.plugged

    @rule()
    def enable(self) -> None:
        """Enable: either refused, or without a jump."""
        before = self.bench.angles()
        was = self.guard.mode
        try:
            state = self.guard.enable()
        except (StateError, LinkError, DeviceFault):
            return
        assert was not in (Mode.DISCONNECTED, Mode.FAULT)
        assert all(abs(t - b) <= STEP_RAD for t, b in zip(state.goal, before, strict=True))
        assert all(motor.on for motor in self.bench.motors)

    @rule(up_down=st.floats(-4, 4), left_right=st.floats(-4, 4), pause_s=st.floats(0.0, 0.1))
    def command(self, up_down: float, left_right: float, pause_s: float) -> None:
        """Send a command after a while."""
        self.bench.wait(pause_s)
        try:
            self.state = self.guard.exchange(Command(position=(up_down, left_right)))
        except HardwareError:
            assert self.guard.mode is not Mode.ENABLED or not self.bench.port.plugged

    @rule()
    def go_on(self) -> None:
        """Exchange without a command."""
        self.bench.wait(PERIOD_S)
        try:
            self.state = self.guard.exchange(None)
        except HardwareError:
            assert self.guard.mode in (Mode.FAULT, Mode.DISCONNECTED)

    @rule()
    def hold(self) -> None:
        """Hold."""
        self.guard.hold()

    @rule()
    def disable(self) -> None:
        """Disable; a motor that cannot be reached is reported."""
        try:
            self.guard.disable()
        except LinkError:
            assert not self.bench.port.plugged

    @rule()
    def clear(self) -> None:
        """Clear any fault; this enables nothing."""
        try:
            self.guard.clear_fault()
        except LinkError:
            assert not self.bench.port.plugged
            return
        assert self.guard.mode is not Mode.FAULT

    @rule()
    def close(self) -> None:
        """Let go."""
        try:
            self.guard.close()
        except LinkError:
            assert not self.bench.port.plugged
        assert self.guard.mode is Mode.DISCONNECTED

    @rule(number=st.integers(1, 2), kind=st.sampled_from(["overheat", "overload", "voltage"]))
    def fail(self, number: int, kind: str) -> None:
        """Latch an error in a motor."""
        self.bench.wire.strike(kind, number)

    @rule(number=st.integers(1, 2))
    def restart(self, number: int) -> None:
        """Take a motor's power for a moment."""
        self.bench.wire.strike("reset", number)

    @precondition(lambda self: self.bench.port.plugged)
    @rule()
    def unplug(self) -> None:
        """Pull the plug."""
        self.bench.port.plugged = False

    @precondition(lambda self: not self.bench.port.plugged)
    @rule()
    def plug(self) -> None:
        """Put it back."""
        self.bench.port.plugged = True

    @rule(pause_s=st.floats(0.0, 3.0))
    def stall(self, pause_s: float) -> None:
        """Let the host sleep; past the watchdog, nothing moves at its end."""
        self.bench.wait(pause_s)
        if pause_s > 1.0:  # the watchdog, and twenty lags more
            held = self.bench.angles()
            self.bench.wait(0.1)
            moved = zip(held, self.bench.angles(), strict=True)
            assert all(abs(a - b) < 1e-6 for a, b in moved)  # a lag's last e^-24

    @rule(why=st.just("the button"))
    def stop(self, why: str) -> None:
        """Press the emergency button."""
        self.guard.estop(why)

    @invariant()
    def disabled_means_off(self) -> None:
        """A guard that says off means off, where it can say so."""
        if self.guard.mode is Mode.DISABLED and self.bench.port.plugged:
            assert not any(motor.on for motor in self.bench.motors)

    @invariant()
    def goals_never_leap(self) -> None:
        """No goal moves faster than allowed, in any sequence of events."""
        goals, now = self._goals(), self.bench.clock.now()
        step_s = min(now - self.moved_at, GuardSettings().max_slew_step_s)
        angles = self.bench.angles()
        for place, (goal, before) in enumerate(zip(goals, self.goals, strict=True)):
            on = self.bench.motors[place].on
            leap = abs(goal - before) > FASTEST_RAD_S * step_s + 2 * STEP_RAD
            # Where a goal leaps it is to where the handle is: enabled, held, or stopped there.
            assert not (on and leap) or abs(goal - angles[place]) <= FASTEST_RAD_S * 0.1 + STEP_RAD
        self.goals, self.moved_at = goals, now

    @invariant()
    def a_state_is_never_made_up(self) -> None:
        """A state marked fresh was true when it was measured."""
        state = self.state
        if state is not None and state.fresh and state.t == self.bench.clock.now():
            rows = zip(state.position, self.bench.angles(), strict=True)
            assert all(abs(p - a) <= STEP_RAD for p, a in rows)

    def _goals(self) -> tuple[float, ...]:
        rows = zip(self.bench.motors, self.bench.angles(), strict=True)
        return tuple(m.goal_rad + angle - m.measure()[0] for m, angle in rows)


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = settings(max_examples=200, stateful_step_count=40)
