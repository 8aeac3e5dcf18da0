"""Faults of a bench: it stops in time, names the reason, and continues only after `clear_fault`.

Virtual time, real bytes. Each entry of `CATALOGUE` injects a fault into a bench that is moving both
handles; the same checks follow for all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import pytest
from tests.hw.emulated import PERIOD_S, STEP_RAD, Emulated

from endolock.hw.api import (
    AXES,
    Command,
    DeviceFault,
    HardwareError,
    LinkLost,
    Mode,
    PortGone,
    StateError,
)
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.servo_drive import WATCHDOG_S, ServoDrive
from endolock.hw.emulator.wire_faults import WireFault
from endolock.hw.guard import Guard, GuardSettings

STOP_S = WATCHDOG_S + 0.04
"""Time after a fault by which both handles must be at rest [s]."""
AIM = (1.2, 1.1)


def _lag(bench: Emulated, lag_s: float) -> None:
    """Catch the left_right handle, whose motor does not move any more, or let it go."""
    bench.motors[1].measure()
    bench.motors[1].lag_s = lag_s


def _restart_both(bench: Emulated) -> None:
    for number in (1, 2):
        bench.wire.strike("reset", number)


class Case(NamedTuple):
    """One thing that happens."""

    do: Callable[[Emulated], object]
    kind: type[HardwareError]
    text: str
    """The whole message."""
    axis: str | None
    fault: str = ""
    undo: Callable[[Emulated], object] = lambda bench: None


AGAIN = r"then clear_fault\(\) and enable\(\)$"
CATALOGUE = {
    "overload": Case(
        lambda b: b.wire.strike("overload", 2),
        DeviceFault,
        r"^handle motor 2 \(left_right\) stopped: its load is too high for too long; free the "
        r"handle, " + AGAIN,
        "left_right",
        "overload",
    ),
    "overload by load": Case(
        lambda b: setattr(b.motors[0], "load_a", 1.1),
        DeviceFault,
        r"^handle motor 1 \(up_down\) stopped: its load is too high",
        "up_down",
        "overload",
        lambda b: setattr(b.motors[0], "load_a", 0.0),
    ),
    "overheat": Case(
        lambda b: b.wire.strike("overheat", 1),
        DeviceFault,
        r"^handle motor 1 \(up_down\) stopped: it is too hot; let it cool, " + AGAIN,
        "up_down",
        "overheat",
    ),
    "voltage": Case(
        lambda b: b.wire.strike("voltage", 2),
        DeviceFault,
        r"^handle motor 2 \(left_right\) stopped: its supply is out of range; check the power "
        r"supply, " + AGAIN,
        "left_right",
        "voltage",
    ),
    "encoder": Case(
        lambda b: b.wire.strike("encoder", 1),
        DeviceFault,
        r"^handle motor 1 \(up_down\) stopped: its encoder fails; replace the motor if it comes "
        r"back, " + AGAIN,
        "up_down",
        "encoder",
    ),
    "power blip of one motor": Case(
        lambda b: b.wire.strike("reset", 2),
        DeviceFault,
        r"^handle motor 2 \(left_right\) has restarted: its power was off for a moment, or "
        r"it was rebooted; check plug and supply, " + AGAIN,
        "left_right",
        "reset",
    ),
    "power blip of both": Case(
        _restart_both,
        DeviceFault,
        r"^handle motor 1 \(up_down\) has restarted",
        "up_down",
        "reset",
    ),
    "host stall": Case(
        lambda b: b.wait(0.5),
        DeviceFault,
        r"^handle motor 1 \(up_down\) stopped by itself: it received no packet for 0\.4 s; it "
        r"holds where it is; find out what delayed the program, " + AGAIN,
        "up_down",
        "watchdog",
    ),
    "unplugged": Case(
        lambda b: setattr(b.port, "plugged", False),
        PortGone,
        r"^loopback is gone; plug it in again",
        None,
        undo=lambda b: setattr(b.port, "plugged", True),
    ),
    "silent line": Case(
        lambda b: b.wire.add(WireFault(kind="silence")),
        LinkLost,
        r"^no answer from up_down and left_right for 0\.\d{3} s; the goal is frozen; check cable "
        r"and power, " + AGAIN,
        "up_down",
        undo=lambda b: b.wire.mend(),
    ),
    "one motor silent": Case(
        lambda b: setattr(b.servos[1], "_started", 1e9),
        LinkLost,
        r"^no answer from left_right for 0\.\d{3} s",
        "left_right",
        undo=lambda b: setattr(b.servos[1], "_started", 0.0),
    ),
    "caught handle": Case(
        lambda b: _lag(b, 1e9),
        DeviceFault,
        r"^handle left_right is \+\d\.\d\d rad from its goal for more than 0\.2 s; .* free the "
        r"handle, " + AGAIN,
        "left_right",
        "following",
        lambda b: _lag(b, 0.025),
    ),
    "emergency stop": Case(
        lambda b: b.guard.estop("the button was pressed"),
        DeviceFault,
        r"^stopped: the button was pressed; remove the cause, " + AGAIN,
        None,
        "estop",
    ),
    "goals that never arrive": Case(
        lambda b: b.wire.add(WireFault(kind="lost", share=1.0)),
        LinkLost,
        r"^no goal reached up_down for 0\.\d{3} s, though it answers; the goal is frozen; check "
        r"the cable, " + AGAIN,
        "up_down",
        undo=lambda b: b.wire.mend(),
    ),
    "wrong baud": Case(
        lambda b: b.port.set_baud(57_600),
        LinkLost,
        r"^no answer from up_down and left_right",
        "up_down",
        undo=lambda b: b.port.set_baud(1_000_000),
    ),
}


def _is(guard: Guard, mode: Mode) -> bool:
    return guard.mode is mode


@pytest.mark.parametrize("case", CATALOGUE.values(), ids=CATALOGUE.keys())
def test_each_fault_stops_with_its_reason_and_stays_latched(case: Case) -> None:
    bench = Emulated()
    with bench.guard as guard:
        guard.enable()
        bench.follow(5, AIM)
        assert min(bench.motors[i].measure()[1] for i in range(2)) > 0.5  # both turn
        case.do(bench)
        began = bench.clock.now()
        with pytest.raises(case.kind, match=case.text) as caught:
            bench.follow(200, AIM)
        assert caught.value.axis == case.axis
        assert getattr(caught.value, "kind", "") == case.fault
        assert _is(guard, Mode.FAULT)
        # Found within the time that the rules allow, and then still within that of the watchdog.
        found = bench.clock.now()
        rules = GuardSettings()
        longest = max(rules.max_age_s, rules.following_time_s + 0.2) + 2 * PERIOD_S
        if case.fault != "overload":  # which a load needs a second for
            assert found - began <= longest
        bench.wait(STOP_S)
        held = bench.angles()
        # Nothing moves it, whatever is asked, until it is cleared and enabled.
        case.undo(bench)
        for _ in range(20):
            bench.wait(PERIOD_S)
            with pytest.raises(HardwareError) as again:
                guard.exchange(Command(position=(0.0, 0.0)))
            assert again.value is caught.value
        with pytest.raises(StateError, match=r"^cannot enable: "):
            guard.enable()
        # A caught handle, set free, settles on the count that it holds.
        assert bench.angles() == pytest.approx(held, abs=STEP_RAD / 2)
        held = bench.angles()
        guard.clear_fault()
        assert _is(guard, Mode.DISABLED)
        with pytest.raises(StateError, match=r"^cannot move while disabled"):
            guard.exchange(Command(position=(0.0, 0.0)))
        assert bench.angles() == pytest.approx(held, abs=1e-6)
        state = guard.enable()
        assert state.position == pytest.approx(held, abs=STEP_RAD / 2)  # zeros kept, to a count
        bench.follow(1)
        assert bench.angles() == pytest.approx(held, abs=STEP_RAD)  # at most one count
        there = bench.follow(100, (0.1, -0.1))[-1]
        assert there.position == pytest.approx((0.1, -0.1), abs=STEP_RAD)


def test_the_other_motor_holds_when_one_restarts() -> None:
    bench = Emulated()
    with bench.guard as guard:
        guard.enable()
        bench.follow(5, AIM)
        bench.wire.strike("reset", 2)
        with pytest.raises(DeviceFault):
            bench.follow(1, AIM)
        assert bench.motors[0].on
        assert not bench.motors[1].on
        at = bench.angles()[0]
        bench.wait(1.0)
        assert bench.angles()[0] == pytest.approx(at, abs=STEP_RAD)  # of the goal it was given


def test_after_the_host_is_killed_the_handles_stop() -> None:
    bench = Emulated()
    bench.guard.connect()
    bench.guard.enable()
    bench.follow(5, AIM)
    bench.wait(STOP_S)  # nobody closes anything
    held = bench.angles()
    bench.wait(10.0)
    assert bench.angles() == pytest.approx(held, abs=1e-6)  # a lag's last e^-18
    assert all(motor.on for motor in bench.motors)  # and hold their load
    block = reg.unpack(bench.servos[0].read(reg.INDIRECT_DATA.address, reg.BLOCK_SIZE))
    assert block.watchdog == reg.TRIPPED


@pytest.mark.parametrize("stop", [0.5, 30.0])
def test_a_host_that_resumes_after_a_stop_moves_nothing(stop: float) -> None:
    """SIGSTOP and SIGCONT as the bus sees them; also over a turn of the device's clock of 33 s."""
    bench = Emulated()
    with bench.guard as guard:
        guard.enable()
        bench.follow(5, AIM)
        bench.wait(stop)
        held = bench.angles()
        with pytest.raises(DeviceFault) as caught:
            bench.follow(1, AIM)
        assert caught.value.kind == "watchdog"
        bench.wait(1.0)
        assert bench.angles() == pytest.approx(held, abs=STEP_RAD)


def test_a_tripped_watchdog_and_torque_are_reset_at_connect() -> None:
    bench = Emulated()
    bench.guard.connect()
    bench.guard.enable()
    bench.follow(5, AIM)
    bench.wait(1.0)  # the host was killed
    held = bench.angles()
    second = Guard(ServoDrive(bench.bus, bench.clock, bench.handles))
    second.connect()
    assert second.mode is Mode.DISABLED
    assert not any(motor.on for motor in bench.motors)
    second.enable()
    bench.wait(PERIOD_S)
    second.exchange(None)
    assert bench.angles() == pytest.approx(held, abs=STEP_RAD)


def test_an_error_latched_before_connecting_is_a_fault_to_be_cleared() -> None:
    bench = Emulated()
    bench.wire.strike("overheat", 2)
    with bench.guard as guard:
        assert guard.mode is Mode.FAULT
        with pytest.raises(StateError, match=r"cannot enable: handle motor 2 .* too hot"):
            guard.enable()
        guard.clear_fault()
        assert guard.enable().mode is Mode.HOLDING


def test_a_homing_offset_is_refused() -> None:
    bench = Emulated()
    bench.bus.write(1, reg.HOMING_OFFSET, 512)
    text = (
        r"^handle motor 1 \(up_down\) has a homing offset of 512 counts, with which it "
        r"would creep after its watchdog has stopped it; set it to 0, and its zero again, with "
    )
    with pytest.raises(StateError, match=text) as caught:
        bench.guard.connect()
    assert caught.value.axis == "up_down"
    assert bench.guard.mode is Mode.DISCONNECTED


def test_an_old_firmware_is_refused() -> None:
    bench = Emulated()
    bench.servos[1]._table[reg.FIRMWARE.address] = 37
    text = r"^handle motor 2 \(left_right\) has firmware 37, without a bus watchdog"
    with pytest.raises(StateError, match=text):
        bench.guard.connect()


def test_clearing_fails_while_the_cause_lasts() -> None:
    bench = Emulated()
    with bench.guard as guard:
        guard.enable()
        bench.port.plugged = False
        with pytest.raises(PortGone):
            bench.follow(1)
        with pytest.raises(PortGone, match="cannot be opened"):
            guard.clear_fault()
        assert guard.mode is Mode.FAULT
        bench.port.plugged = True
        guard.clear_fault()
        guard.enable()


def test_a_restart_keeps_the_zero_over_whole_turns() -> None:
    bench = Emulated()
    with bench.guard as guard:
        guard.enable()
        bench.follow(120, (3.0, -3.0))  # counts 4004 and 92: either side of half a turn
        guard.disable()
        _restart_both(bench)
        guard.estop("tried")
        with pytest.raises(DeviceFault):
            guard.exchange(None)
        guard.clear_fault()
        assert guard.enable().position == pytest.approx((3.0, -3.0), abs=0.002)  # droop, a count


@pytest.mark.parametrize("zero", [4090, 10, 2048])
def test_power_on_takes_the_turn_next_to_the_zero(zero: int) -> None:
    """A motor wakes up within 0..4095, wherever it was when its zero was taken."""
    handles = {a: Handle(id=i, zero_counts=zero) for i, a in enumerate(AXES, 1)}
    bench = Emulated(handles=handles)
    for servo, away in zip(bench.servos, (10, -900), strict=True):
        servo._start((zero + away) % reg.TURN)
    with bench.guard as guard:
        state = guard.enable()
        assert state.position == pytest.approx((10 * STEP_RAD, -900 * STEP_RAD))  # rounding
        assert guard.limits.position_rad == tuple(h.range_rad for h in handles.values())
