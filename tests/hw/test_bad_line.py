"""A line that loses packets: handles still connect, and a blocked one is still not pushed."""

from __future__ import annotations

import pytest
from tests.hw.emulated import STEP_RAD, Emulated

from endolock.hw.api import AXES, Command, DeviceFault, Mode
from endolock.hw.confirmed import KEPT
from endolock.hw.dynamixel.packets import Instruction, Parser
from endolock.hw.emulator.wire_faults import WireFault

PERIOD_S = 0.033
LOSSES = 0.1
"""Share of packets that lose a byte [1]: many, so that several of a stop are hit. Assumed."""


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("seed", range(6))
def test_a_blocked_handle_is_not_pushed_after_its_fault(axis: int, seed: int) -> None:
    bench = Emulated(seed=seed)
    blocked = bench.motors[axis]
    bench.guard.connect()
    bench.guard.enable()
    blocked.lag_s = 1e9
    bench.wire.add(WireFault(kind="drop", share=LOSSES))
    goal = tuple(1.2 if n == axis else 0.0 for n in range(len(AXES)))

    def push() -> None:
        for _ in range(100):
            bench.wait(PERIOD_S)
            bench.guard.exchange(Command(position=goal))

    with pytest.raises(DeviceFault, match="is frozen where it stands") as fault:
        push()
    assert (fault.value.kind, fault.value.axis) == ("following", AXES[axis])
    # Its motor holds the position measured, which is half a step off at most.
    assert abs(blocked.goal_rad - blocked.measure()[0]) <= STEP_RAD


@pytest.mark.parametrize("lost", range(KEPT))
def test_one_lost_cycle_at_connecting_is_no_fault(lost: int) -> None:
    bench = Emulated()
    honest = bench.wire.respond
    cycles: list[int] = []

    def respond(data: bytes, baud: int | None = None) -> list[bytes]:
        asked = [packet.instruction for packet in Parser().feed(data)]
        cycles.extend(kind for kind in asked if kind == Instruction.SYNC_READ)
        dropped = Instruction.SYNC_READ in asked and len(cycles) == lost + 1
        return [] if dropped else honest(data, baud)

    bench.wire.respond = respond  # type: ignore[method-assign]  # it is the line that is on trial
    bench.guard.connect()
    assert len(cycles) == KEPT
    assert bench.guard.mode is Mode.DISABLED
