"""Guard, drive, bus and port on a real pseudo-terminal, in wall-clock time.

Few tests, since a busy machine makes them late; everything else is tested in virtual time.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.hw.emulated import STEP_RAD
from tests.hw.served import Served, servo

from endolock.hw.api import AXES, Command, DeviceFault, LinkLost, PortGone
from endolock.hw.bench.wall_clock import WallClock
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.linux_port import SerialPort
from endolock.hw.dynamixel.servo_bus import Bus
from endolock.hw.dynamixel.servo_drive import WATCHDOG_S, ServoDrive
from endolock.hw.emulator.pty_line import PtyLine
from endolock.hw.guard import Guard, GuardSettings

pytestmark = pytest.mark.wall_time

PATIENT = GuardSettings(max_age_s=5.0)
"""A machine that is busy elsewhere for a moment is no fault of these tests."""
HANDLES = {axis: Handle(id=i, zero_counts=2048) for i, axis in enumerate(AXES, 1)}


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    """Two servos on a line with a lasting name."""
    with Served(servo(1), servo(2), link=tmp_path / "servo") as line:
        yield line


def bench(line: Served, settings: GuardSettings = PATIENT, baud: int = 1_000_000) -> Guard:
    """Make everything from guard to port."""
    clock = WallClock()
    bus = Bus(SerialPort(line.path, baud), clock, dict(enumerate(AXES, 1)), timeout_s=0.2)
    # As patient as the guard: a motor's own watchdog is asked after where it matters.
    return Guard(ServoDrive(bus, clock, HANDLES, watchdog_s=2.0), settings)


def follow(guard: Guard, position: tuple[float, float], seconds: float) -> None:
    """Exchange every 20 ms."""
    start = guard.clock.now()
    while guard.clock.now() < start + seconds:
        guard.exchange(Command(position=position))
        time.sleep(0.02)


def positions(line: Served) -> list[int]:
    """Where the motors are [counts]."""
    read = (servo.read(*reg.POSITION) for servo in line.bus.servos)
    return [int.from_bytes(data, "little", signed=True) for data in read]


def test_a_port_replugged_under_a_new_name_continues_at_its_position(served: Served) -> None:
    with bench(served) as guard:
        guard.enable()
        follow(guard, (0.4, -0.3), 0.5)
        old = Path(served.path).resolve()
        served.pull.set()
        with pytest.raises(PortGone, match=r"is gone; .* plug it in again, then clear_fault"):
            follow(guard, (0.4, -0.3), 20.0)
        with pytest.raises(PortGone):
            guard.clear_fault()
        spare = PtyLine()  # takes the old name
        served.pull.clear()
        link = Path(served.path)
        while link.resolve() == old or not link.exists():  # until the name leads to the new line
            time.sleep(0.01)
        spare.close()
        held = positions(served)
        guard.clear_fault()
        state = guard.enable()
        guard.exchange(None)
        moved = zip(held, positions(served), strict=True)
        assert all(abs(now - before) <= 1 for before, now in moved)
        assert state.position == pytest.approx((0.4, -0.3), abs=2 * STEP_RAD)  # a count of droop


def test_a_stalled_host_finds_its_motors_stopped(served: Served) -> None:
    clock = WallClock()
    bus = Bus(SerialPort(served.path, 1_000_000), clock, dict(enumerate(AXES, 1)), timeout_s=0.2)
    with Guard(ServoDrive(bus, clock, HANDLES), PATIENT) as guard:
        guard.enable()
        guard.exchange(Command(position=(1.0, 1.0)))
        time.sleep(WATCHDOG_S + 0.1)
        with pytest.raises(DeviceFault) as caught:
            guard.exchange(None)
        assert (caught.value.kind, caught.value.axis) == ("watchdog", "up_down")


def test_no_answer_at_the_wrong_baud_rate_is_reported(served: Served) -> None:
    guard = bench(served, baud=57_600)
    text = r"^handle motor 1 \(up_down\) did not answer within 0\.200 s on .* \(3 tries\); "
    with pytest.raises(LinkLost, match=text + "check power and cable, then run endolock doctor$"):
        guard.connect()
    guard.close()
