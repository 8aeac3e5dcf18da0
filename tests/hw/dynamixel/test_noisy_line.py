"""A noisy line: no corrupted packet is accepted, and no old state is reported as fresh."""

from __future__ import annotations

from math import pi, sin
from typing import NamedTuple

import pytest
from tests.hw.emulated import PERIOD_S, STEP_RAD, Emulated

from endolock.hw.api import Command, State
from endolock.hw.dynamixel import registers as reg
from endolock.hw.emulator.wire_faults import RANDOM, WireFault
from endolock.hw.guard import Guard, GuardSettings

CYCLES = 2000
SHARE = 0.05


class Cycle(NamedTuple):
    """The state that the host received, and the true values."""

    state: State
    position: tuple[float, ...]
    goal: tuple[float, ...]
    struck: bool
    """Whether the line corrupted or lost something in this cycle."""


def drive_along(
    bench: Emulated, kinds: tuple[str, ...], cycles: int, period_s: float = PERIOD_S
) -> list[Cycle]:
    """Move both handles back and forth over a line with faults; silences raise no fault."""
    patient = GuardSettings(max_age_s=60.0, following_error_rad=10.0)
    guard = Guard(bench.drive, patient)
    cycles_done = []
    guard.connect()
    guard.enable()
    for kind in kinds:
        bench.wire.add(WireFault(kind=kind, share=SHARE))
    for n in range(cycles):
        bench.wait(period_s)
        before = bench.wire.struck
        phase = 2 * pi * n * period_s / 3.0
        command = Command(position=(sin(phase), 0.7 * sin(1.3 * phase)))
        state = guard.exchange(command)
        counts = [_position(bench, i) for i in (0, 1)]
        goals = [_register(bench, i, reg.GOAL_POSITION) for i in (0, 1)]
        cycles_done.append(
            Cycle(state, _angles(counts), _angles(goals), bench.wire.struck > before)
        )
    return cycles_done


def _position(bench: Emulated, place: int) -> int:
    return _register(bench, place, reg.POSITION)


def _register(bench: Emulated, place: int, register: reg.Register) -> int:
    data = bench.servos[place].read(*register)
    return int.from_bytes(data, "little", signed=True)


def _angles(counts: list[int]) -> tuple[float, ...]:
    return tuple((c - 2048) * STEP_RAD for c in counts)


@pytest.mark.parametrize("kinds", [*((kind,) for kind in RANDOM), RANDOM])
@pytest.mark.parametrize("period_s", [PERIOD_S, 0.005])
def test_no_corrupted_packet_is_accepted(kinds: tuple[str, ...], period_s: float) -> None:
    bench = Emulated(seed=7)
    cycles = drive_along(bench, kinds, CYCLES, period_s)
    assert sum(c.struck for c in cycles) > CYCLES * SHARE / 2  # the line did its worst
    known: tuple[float, ...] = (0.0, 0.0)  # as enabled
    in_force = known
    for n, cycle in enumerate(cycles):
        state = cycle.state
        if state.fresh:
            assert state.position == cycle.position  # to the bit: whole counts
            # A goal in force during this exchange, not that which was sent and got lost.
            assert state.goal in (cycle.goal, in_force)
            assert state.t == pytest.approx((n + 1) * period_s, abs=1e-9)  # rounding
        else:  # flagged: each either new, or the last that was known
            rows = zip(state.position, cycle.position, known, strict=True)
            assert all(p in (new, old) for p, new, old in rows)
        known, in_force = state.position, cycle.goal
    spoilt = [c.struck for c in cycles]
    for n in range(2, CYCLES):
        if not spoilt[n] and not spoilt[n - 1]:
            assert cycles[n].state.fresh  # a bad cycle costs at most the next one
    assert any(not c.state.fresh for c in cycles) or kinds in (("lost",), ("duplicate",))


def test_a_clean_line_is_always_fresh() -> None:
    bench = Emulated()
    cycles = drive_along(bench, (), 200)
    assert all(c.state.fresh and c.state.position == c.position for c in cycles)
