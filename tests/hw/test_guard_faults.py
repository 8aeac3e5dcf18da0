"""How a guard meets handles that do not follow, answers that do not come, drives that break."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from endolock.hw.api import (
    Command,
    CommandError,
    DeviceFault,
    HardwareError,
    LinkLost,
    Mode,
    State,
    StateError,
)
from endolock.hw.guard import Guard, GuardSettings

if TYPE_CHECKING:
    from tests.hw.conftest import BenchDrive, Make

PERIOD_S = 0.02


def exchange(guard: Guard, n: int, position: tuple[float, float] | None = None) -> list[State]:
    """Exchange this number of times, 20 ms apart."""
    states = []
    for _ in range(n):
        guard.clock.sleep_until(guard.clock.now() + PERIOD_S)
        states.append(guard.exchange(Command(position=position) if position else None))
    return states


@pytest.mark.parametrize("sign", [1, -1])
def test_a_following_error_latches_until_cleared(make: Make, sign: int) -> None:
    with make(blocked=True) as guard:
        guard.enable()
        text = rf"^handle left_right is \{'+' if sign > 0 else '-'}\d\.\d\d rad from its goal for "
        text += r"more than 0\.2 s; .*; free the handle, then clear_fault\(\) and enable\(\)$"
        with pytest.raises(DeviceFault, match=text) as caught:
            exchange(guard, 100, (0.0, sign * 1.2))
        assert (caught.value.kind, caught.value.axis) == ("following", "left_right")
        assert guard.mode is Mode.FAULT
        with pytest.raises(DeviceFault) as again:
            guard.exchange(None)
        assert again.value is caught.value
        with pytest.raises(StateError, match=r"^cannot enable: .*, then clear_fault\(\)$"):
            guard.enable()
        guard.disable()
        assert guard.mode is Mode.FAULT  # switching off does not forget
        guard.clear_fault()
        assert guard.exchange(None).mode is Mode.DISABLED
        assert guard.enable().mode is Mode.HOLDING


def test_a_following_error_needs_both_distance_and_time(make: Make) -> None:
    with make(blocked=True) as guard:
        up_down, start = guard.enable().position
        near, far = (up_down, start + 0.45), (up_down, start + 0.6)  # either side of 0.5 rad
        for _ in range(3):
            stays = exchange(guard, 50, near)[-1]
            assert stays.goal[1] - stays.position[1] > 0.4  # behind, for long
            leaves = exchange(guard, 5, far)[-1]
            assert leaves.goal[1] - leaves.position[1] > 0.5  # too far, for 0.1 s
        with pytest.raises(DeviceFault):
            exchange(guard, 50, far)


def test_one_lost_answer_only_makes_the_state_stale(bench: BenchDrive) -> None:
    with Guard(bench) as guard:
        guard.clock.sleep_until(5.0)  # the age counts from enable(), not from power on
        guard.enable()
        bench.answers = False
        assert not exchange(guard, 1)[0].fresh
        bench.answers = True
        before = exchange(guard, 4, (0.9, 0.9))[-1]
        bench.answers = False
        (lost,) = exchange(guard, 1, (0.9, 0.9))
        assert not lost.fresh
        assert (lost.t, lost.position) == (before.t, before.position)  # the last measurements
        assert all(b > a for a, b in zip(before.goal, lost.goal, strict=True))  # goes on
        bench.answers = True
        (found,) = exchange(guard, 1, (0.9, 0.9))
        assert found.fresh
        assert all(b > a for a, b in zip(before.position, found.position, strict=True))
        assert [before.seq, lost.seq, found.seq] == [5, 6, 7]  # enable() was 0


@pytest.mark.parametrize("max_age_s", [0.03, 0.1, 0.25])
def test_silence_beyond_the_allowed_age_is_a_lost_link(bench: BenchDrive, max_age_s: float) -> None:
    with Guard(bench, GuardSettings(max_age_s=max_age_s)) as guard:
        guard.enable()
        exchange(guard, 3)
        heard = guard.clock.now()
        bench.answers = False
        with pytest.raises(LinkLost, match=r"^no answer from the handles for 0\.\d{3} s;") as e:
            exchange(guard, 100)
        # The first exchange beyond the age, with room for the rounding of the clock.
        assert max_age_s < e.value.t - heard <= max_age_s + PERIOD_S + 1e-9
        assert guard.mode is Mode.FAULT
        bench.answers = True  # an answer does not heal it
        with pytest.raises(LinkLost, match=r"clear_fault\(\) and enable\(\)$"):
            guard.exchange(None)
        guard.clear_fault()
        assert not bench.on
        guard.enable()
        assert exchange(guard, 3)[-1].fresh


def test_occasional_answers_keep_the_link(bench: BenchDrive) -> None:
    with Guard(bench) as guard:
        guard.enable()
        for n in range(100):
            bench.answers = n % 5 == 4  # every 0.1 s, just the allowed age
            (state,) = exchange(guard, 1)
            assert state.fresh == bench.answers


def test_a_pause_of_the_program_is_no_silence(bench: BenchDrive) -> None:
    with Guard(bench) as guard:
        guard.enable()
        exchange(guard, 3)
        guard.clock.sleep_until(guard.clock.now() + 1.0)  # the machine was busy elsewhere
        bench.answers = False
        assert not any(state.fresh for state in exchange(guard, 5))
        bench.answers = True
        assert exchange(guard, 1)[0].fresh


def test_the_time_that_enabling_takes_moves_no_goal(bench: BenchDrive) -> None:
    switch = bench.torque

    def slowly(on: bool) -> None:
        bench.clock.sleep_until(bench.clock.now() + 0.3)  # requests were repeated
        switch(on)

    bench.torque = slowly  # type: ignore[method-assign]  # it is the drive that is on trial
    with Guard(bench) as guard:
        start = guard.enable().goal
        (state,) = exchange(guard, 1, (0.9, 0.9))
        for begin, goal, speed in zip(start, state.goal, guard.limits.velocity_rad_s, strict=True):
            assert 0 < goal - begin <= speed * PERIOD_S + bench.STEP_RAD  # rounded


def test_the_goal_waits_while_no_answer_comes(bench: BenchDrive) -> None:
    with Guard(bench, GuardSettings(max_age_s=1.0)) as guard:
        guard.enable()
        start = exchange(guard, 1, (0.9, 0.9))[0].goal
        bench.answers = False
        silent = exchange(guard, 40, (0.9, 0.9))
        step_s = GuardSettings().max_slew_step_s
        for begin, goal, speed in zip(
            start, silent[-1].goal, guard.limits.velocity_rad_s, strict=True
        ):
            assert 0 < goal - begin <= speed * (step_s + PERIOD_S) + bench.STEP_RAD  # rounded
        bench.answers = True
        # It goes on from there, at its usual speed.
        exchange(guard, 1, (0.9, 0.9))
        first, second = (state.goal for state in exchange(guard, 2, (0.9, 0.9)))
        assert all(
            0 < b - a <= 3.0 * PERIOD_S + bench.STEP_RAD for a, b in zip(first, second, strict=True)
        )


def test_a_blocked_handle_is_not_pushed_any_further(bench: BenchDrive) -> None:
    with Guard(bench) as guard:
        guard.enable()
        stuck = bench.handle
        bench.blocked = True
        with pytest.raises(DeviceFault) as e:
            exchange(guard, 100, (0.3, 1.4))
        assert e.value.axis == "left_right"
        bench.blocked = False
        guard.clock.sleep_until(guard.clock.now() + 1.0)
        bench.transfer(None)
        # The goal went back to where it was measured, to the nearest half step.
        assert bench.handle == pytest.approx(stuck, abs=bench.STEP_RAD / 2)
        guard.clear_fault()
        guard.enable()
        # Freed, it arrives: 80 periods are 1.1 rad of slew at 1.5 rad/s and many lags.
        assert exchange(guard, 80, (0.3, 0.9))[-1].position == pytest.approx(
            (0.3, 0.9),
            abs=bench.STEP_RAD,  # of the encoder
        )


def test_torque_is_switched_on_only_after_the_goal_is_written(bench: BenchDrive) -> None:
    start = bench.handle  # not zero, while zero is the goal that such a drive wakes up with
    with Guard(bench) as guard:
        guard.enable()
        assert bench.on
        exchange(guard, 50)
        assert bench.handle == pytest.approx(start, abs=bench.STEP_RAD / 2)  # nearest step
    assert not bench.on


def test_a_fault_of_the_device_is_latched_too(bench: BenchDrive) -> None:
    with Guard(bench) as guard:
        guard.enable()
        bench.breaks = fault = DeviceFault("motor 2 is hot", kind="overheat", t=0.0)
        with pytest.raises(DeviceFault, match=r"^motor 2 is hot") as e:
            guard.exchange(None)
        assert guard.mode is Mode.FAULT
        assert e.value is fault
        # Where even holding fails, the first error says so; it is not replaced.
        assert e.value.__notes__ == ["the hold command failed: motor 2 is hot"]
        bench.breaks = None


def test_an_error_while_closing_a_drive_hides_no_other(bench: BenchDrive) -> None:
    def leave() -> None:
        with Guard(bench):
            bench.breaks = HardwareError("cable gone", t=0.0)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        leave()


def test_an_error_while_closing_a_drive_is_reported(bench: BenchDrive) -> None:
    guard = Guard(bench)
    with pytest.raises(HardwareError, match=r"^cable gone$"), guard:
        bench.breaks = HardwareError("cable gone", t=0.0)
    assert guard.mode is Mode.DISCONNECTED
    guard.close()  # a second time finds nothing to do


def test_handles_that_do_not_answer_are_not_enabled(bench: BenchDrive) -> None:
    with Guard(bench) as guard:
        guard.exchange(None)
        bench.answers = False
        bench.handle = (0.9, 0.9)  # turned by hand meanwhile
        with pytest.raises(LinkLost, match=r"^the handles do not answer, so enabling could make"):
            guard.enable()
        assert not bench.on
        bench.answers = True
        # To the nearest half step of the encoder.
        assert guard.enable().goal == pytest.approx((0.9, 0.9), abs=bench.STEP_RAD / 2)


def test_a_fault_while_enabling_is_latched(bench: BenchDrive) -> None:
    with Guard(bench) as guard:
        bench.breaks = DeviceFault("motor 1 is reset", kind="reset", t=0.0)
        with pytest.raises(DeviceFault):
            guard.enable()
        bench.breaks = None
        assert guard.mode is Mode.FAULT
        with pytest.raises(StateError, match=r"^cannot enable: motor 1 is reset; call clear_fault"):
            guard.enable()
        guard.close()
        guard.connect()
        assert guard.mode is Mode.FAULT  # closing does not forget either
        with pytest.raises(
            StateError, match=r"^cannot home while fault; call clear_fault\(\) first$"
        ):
            guard.home()


def test_a_lost_link_keeps_the_goal(bench: BenchDrive) -> None:
    with Guard(bench) as guard:
        guard.enable()
        last = exchange(guard, 10, (0.9, 0.9))[-1]
        bench.answers = False  # goals still arrive
        with pytest.raises(LinkLost):
            exchange(guard, 100)
        guard.clock.sleep_until(guard.clock.now() + 1.0)
        bench.transfer(None)
        # The handles went on to the goal in force, not back to the last position heard of.
        assert all(h >= p for h, p in zip(bench.handle, last.goal, strict=True))


def test_age_counts_from_connecting(bench: BenchDrive) -> None:
    bench.clock.sleep_until(5.0)
    with Guard(bench) as guard:
        bench.answers = False
        assert not guard.exchange(None).fresh


@pytest.mark.parametrize("valid_for", [0.0, -1.0, float("nan"), float("inf")])
def test_a_command_must_expire(guard: Guard, valid_for: float) -> None:
    guard.enable()
    with pytest.raises(CommandError, match=r"^command is valid for .* s; give a finite time"):
        guard.exchange(Command(position=(0.1, 0.1), valid_for=valid_for))
    assert guard.mode is Mode.HOLDING


def test_clipping_is_reported_while_it_lasts(bench: BenchDrive) -> None:
    with Guard(bench) as guard:
        guard.enable()
        guard.exchange(Command(position=(9.0, -9.0), valid_for=60.0))
        assert {state.clipped for state in exchange(guard, 100)} == {(1, -1)}
        guard.hold()
        assert exchange(guard, 1)[0].clipped == (0, 0)


def test_without_torque_the_goal_is_where_the_handles_are(bench: BenchDrive) -> None:
    with Guard(bench) as guard:
        guard.enable()
        exchange(guard, 60, (0.9, 0.9))
        guard.disable()
        bench.handle = (0.0, 0.0)
        assert exchange(guard, 1)[0].goal == (0.0, 0.0)


def test_a_new_zero_forgets_the_old_history(guard: Guard) -> None:
    guard.enable()
    exchange(guard, 10, (0.2, 0.2))
    guard.disable()
    guard.home()
    with pytest.raises(LookupError):
        guard.history(0.1)
