"""What a guard promises, in front of every drive: the contract of `Actuators`."""

from __future__ import annotations

from itertools import pairwise
from math import inf, nan
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.hw.api import Command, CommandError, Mode, State, StateError
from endolock.hw.guard import Guard, GuardSettings

if TYPE_CHECKING:
    from tests.hw.conftest import Make

PERIOD_S = 0.02
STEP_RAD = 0.0016  # the coarser of the two encoders: 2 pi / 4096, rounded up
SAG_RAD = 0.01  # the twin's wires pull back with up to 0.11 N m here; its servo has 20 N m/rad


def follow(guard: Guard, position: tuple[float, float] | None, duration_s: float) -> list[State]:
    """Exchange every 20 ms, always with the same command, or with none."""
    start = guard.clock.now()
    states = []
    for n in range(1, round(duration_s / PERIOD_S) + 1):
        guard.clock.sleep_until(start + n * PERIOD_S)
        states.append(guard.exchange(Command(position=position) if position else None))
    return states


def advanced(before: State, after: State) -> bool:
    """Whether the goals of both axes have grown."""
    return all(b > a for a, b in zip(before.goal, after.goal, strict=True))


def test_connecting_leaves_the_motors_off(make: Make) -> None:
    assert make().mode is Mode.DISCONNECTED
    with make() as guard:
        guard.connect()  # a second time changes nothing
        assert guard.mode is Mode.DISABLED
        assert guard.exchange(None).mode is Mode.DISABLED


def test_nothing_works_before_connect(make: Make) -> None:
    guard = make()
    with pytest.raises(
        StateError, match=r"^cannot exchange while disconnected; call connect\(\) first$"
    ):
        guard.exchange(None)
    with pytest.raises(
        StateError, match=r"^cannot enable while disconnected; call connect\(\) first$"
    ):
        guard.enable()


def test_enable_is_bumpless(guard: Guard) -> None:
    guard.enable()
    follow(guard, (0.4, -0.3), 0.5)
    guard.disable()
    follow(guard, None, 0.2)
    state = guard.enable()
    assert state.mode is Mode.HOLDING
    assert state.goal == state.position  # exactly: both are whole encoder steps
    for later in follow(guard, None, 0.5):
        assert later.goal == state.goal
        assert later.position == pytest.approx(state.position, abs=SAG_RAD)  # takes up the load


def test_a_command_needs_enable(guard: Guard) -> None:
    with pytest.raises(StateError, match=r"^cannot move while disabled; call enable\(\) first"):
        guard.exchange(Command(position=(0.1, 0.1)))
    before = guard.exchange(None).position
    after = follow(guard, None, 0.2)[-1]
    assert after.mode is Mode.DISABLED
    assert after.position == pytest.approx(before, abs=STEP_RAD)  # may stand between two steps


def test_hold_freezes_the_goal_until_the_next_command(guard: Guard) -> None:
    guard.hold()
    assert guard.mode is Mode.DISABLED  # there is nothing to hold
    guard.enable()
    moving = follow(guard, (0.9, 0.9), 0.1)[-1]
    guard.hold()
    held = follow(guard, None, 0.3)
    assert {state.mode for state in held} == {Mode.HOLDING}
    assert {state.goal for state in held} == {moving.goal}
    going_on = follow(guard, (0.9, 0.9), 0.04)[-1]
    assert going_on.mode is Mode.ENABLED
    assert advanced(moving, going_on)


def test_an_expired_command_becomes_a_hold(guard: Guard) -> None:
    guard.enable()
    start = guard.exchange(Command(position=(0.9, 0.9), valid_for=0.1)).t
    states = follow(guard, None, 0.4)
    valid = [state for state in states if state.t <= start + 0.1 - 1e-9]  # less rounding
    over = [state for state in states if state.t > start + 0.1 + 1e-9]
    assert {state.mode for state in valid} == {Mode.ENABLED}
    assert all(advanced(a, b) for a, b in pairwise(valid))  # it went on without a command
    assert {state.mode for state in over} == {Mode.HOLDING}
    assert len({state.goal for state in over}) == 1


def test_home_makes_the_current_position_the_zero(guard: Guard) -> None:
    guard.enable()
    away = follow(guard, (0.4, -0.3), 0.5)[-1].position
    with pytest.raises(StateError, match=r"^cannot home while enabled; call disable\(\) first$"):
        guard.home()
    assert guard.exchange(None).position == pytest.approx(away, abs=STEP_RAD)  # refused
    guard.disable()
    guard.home()
    # A handle between two steps reads as either.
    assert guard.exchange(None).position == pytest.approx((0, 0), abs=STEP_RAD)
    guard.enable()
    states = follow(guard, (0.0, 0.0), 0.2)
    for state in states:
        assert state.position == pytest.approx((0, 0), abs=SAG_RAD)  # takes up the load


def test_close_may_be_called_twice(guard: Guard) -> None:
    guard.enable()
    guard.close()
    guard.close()
    assert guard.mode is Mode.DISCONNECTED
    with pytest.raises(StateError, match="while disconnected"):
        guard.exchange(None)


def test_an_exception_in_the_context_propagates(make: Make) -> None:
    guard = make()

    def leave() -> None:
        with guard:
            guard.enable()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        leave()
    assert guard.mode is Mode.DISCONNECTED


def test_a_command_within_limits_is_reached(guard: Guard) -> None:
    guard.enable()
    state = follow(guard, (0.4, -0.3), 1.0)[-1]
    assert state.mode is Mode.ENABLED
    assert state.clipped == (0, 0)
    assert state.goal == pytest.approx((0.4, -0.3), abs=STEP_RAD / 2)  # nearest step
    assert state.position == pytest.approx((0.4, -0.3), abs=SAG_RAD)  # under load


@pytest.mark.parametrize("sign", [1, -1])
def test_a_goal_over_the_limit_is_clipped_and_its_direction_reported(
    guard: Guard, sign: int
) -> None:
    guard.enable()
    states = follow(guard, (sign * 99.0, -sign * 99.0), 3.0)
    (low_ud, high_ud), (low_lr, high_lr) = guard.limits.position_rad
    end = (high_ud, low_lr) if sign > 0 else (low_ud, high_lr)
    assert states[-1].goal == pytest.approx(end, abs=STEP_RAD / 2)  # nearest step
    assert {state.clipped for state in states} == {(sign, -sign)}
    back = follow(guard, (0.0, 0.0), 3.0)
    assert back[0].clipped == (-sign, sign)  # not there yet: slew clips too
    assert back[-1].clipped == (0, 0)


@settings(max_examples=25)
@given(
    moves=st.lists(
        st.tuples(
            st.floats(-4, 4),
            st.floats(-4, 4),
            st.integers(0, 300).map(lambda ms: ms / 1000),
            st.sampled_from(["command", "none", "hold"]),
        ),
        min_size=2,
        max_size=12,
    )
)
def test_the_goal_is_never_faster_than_allowed(
    make: Make, moves: list[tuple[float, float, float, str]]
) -> None:
    with make() as guard:
        last, at = guard.enable().goal, guard.clock.now()
        for up_down, left_right, pause_s, kind in moves:
            guard.clock.sleep_until(at + pause_s)
            if kind == "hold":
                guard.hold()
            command = Command(position=(up_down, left_right)) if kind == "command" else None
            now, state = guard.clock.now(), guard.exchange(command)
            step_s = min(now - at, GuardSettings().max_slew_step_s)  # no leap after a pause
            for i, speed in enumerate(guard.limits.velocity_rad_s):
                # Both goals are rounded to half a step.
                assert abs(state.goal[i] - last[i]) <= speed * step_s + STEP_RAD
                low, high = guard.limits.position_rad[i]
                assert low - STEP_RAD / 2 <= state.goal[i] <= high + STEP_RAD / 2  # rounded
            last, at = state.goal, now


@pytest.mark.parametrize(
    ("position", "axis", "text"),
    [
        ((nan, 0.0), "up_down", "^command for up_down is nan; give a finite angle in rad"),
        ((0.0, nan), "left_right", "^command for left_right is nan; give a finite angle"),
        ((0.0, -inf), "left_right", r"is -inf; .* \(the previous goal stays\)$"),
        ((0.1,), None, "^command has 1 positions; give 2: up_down, left_right$"),
        ((0.1, 0.1, 0.1), None, "^command has 3 positions; give 2: up_down, left_right$"),
        ("12", None, "^command '12', valid for 0.2 s, is not of numbers; give angles in rad"),
        (["a", 0.1], None, "^command .'a', 0.1., valid for 0.2 s, is not of numbers"),
        (None, None, "^command None, valid for 0.2 s, is not of numbers"),
        ((10**400, 0.1), None, "is not of numbers"),
        ({0.1: 0.2, 0.3: 0.4}, None, "is not of numbers"),
    ],
)
def test_invalid_commands_are_refused_and_keep_the_previous_goal(
    guard: Guard, position: Any, axis: str | None, text: str
) -> None:
    guard.enable()
    before = follow(guard, (0.2, -0.2), 0.6)[-1]
    with pytest.raises(CommandError, match=text) as caught:
        guard.exchange(Command(position=position))
    assert caught.value.axis == axis
    assert caught.value.t == guard.clock.now()
    after = follow(guard, None, 0.1)[-1]  # time enough to move, and too little to expire
    assert (after.goal, after.mode) == (before.goal, Mode.ENABLED)


@pytest.mark.parametrize("given", [(0.1, 0.0), "0.1", 0.1, {"position": (0.1, 0.0)}])
def test_what_is_no_command_is_refused(guard: Guard, given: Any) -> None:
    guard.enable()
    with pytest.raises(CommandError, match=r"which is not a command; give Command\(position"):
        guard.exchange(given)
    assert guard.mode is Mode.HOLDING  # as after enable()


def test_numpy_numbers_are_accepted(guard: Guard) -> None:
    guard.enable()
    guard.clock.sleep_until(guard.clock.now() + PERIOD_S)
    state = guard.exchange(Command(position=list(np.array([9.0, -9.0]))))
    assert state.clipped == (1, -1)


def test_states_are_counted_and_remembered(guard: Guard) -> None:
    states = [guard.enable(), *follow(guard, (0.4, -0.3), 0.2)]
    assert [state.seq for state in states] == list(range(states[0].seq, states[0].seq + 11))
    a, b = states[4], states[5]
    between = guard.history((a.t + b.t) / 2)
    assert a.position[0] < between.position[0] < b.position[0]
    with pytest.raises(LookupError):
        guard.history(states[-1].t + PERIOD_S)
