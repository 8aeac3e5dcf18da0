"""Torque is off where it is said to be off, whatever a line does to the words."""

from __future__ import annotations

import resource
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.hw.emulated import STEP_RAD, Emulated

from endolock.hw.api import AXES, Command, ConfigError, HardwareError, LinkLost, Mode, StateError
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.packets import Instruction, Parser

Lose = Callable[[int, int, bytes], bool]
"""Whether a request is lost: id, instruction, parameters."""


def losing(bench: Emulated, lose: Lose, *, late: bool = False) -> None:
    """Let a line lose some requests, or deliver every answer one request late."""
    honest = bench.wire.respond
    held: list[bytes] = []

    def respond(data: bytes, baud: int | None = None) -> list[bytes]:
        nonlocal held
        lost = any(lose(*packet) for packet in Parser().feed(data))
        answers = [] if lost else honest(data, baud)
        if not late:
            return answers
        delayed, held = held, answers
        return delayed

    bench.wire.respond = respond  # type: ignore[method-assign]  # it is the line that is on trial


def torque_off_of(motor: int) -> Lose:
    """Lose what would switch a motor's torque off."""

    def lose(device: int, instruction: int, parameters: bytes) -> bool:
        off = parameters[:3] == bytes((reg.TORQUE_ENABLE.address, 0, 0))
        return (device, instruction) == (motor, Instruction.WRITE) and off

    return lose


def on(bench: Emulated) -> list[bool]:
    """Whether each motor has torque."""
    return [motor.on for motor in bench.motors]


def guarded_by_themselves(bench: Emulated) -> bool:
    """Whether every motor that has torque has its watchdog, too."""
    rows = zip(bench.servos, bench.motors, strict=True)
    return all(int.from_bytes(s.read(*reg.WATCHDOG)) != 0 for s, motor in rows if motor.on)


def test_a_motor_that_cannot_be_switched_off_is_a_latched_fault() -> None:
    bench = Emulated()
    bench.guard.connect()
    bench.guard.enable()
    bench.follow(20, (0.3, 0.3))
    losing(bench, torque_off_of(2))
    with pytest.raises(LinkLost, match=r"^handle motor 2 \(left_right\) did not answer") as caught:
        bench.guard.disable()
    assert caught.value.axis == "left_right"
    assert bench.guard.mode is Mode.FAULT
    assert on(bench) == [False, True]
    assert guarded_by_themselves(bench)
    held = bench.angles()
    with pytest.raises(LinkLost):
        bench.guard.exchange(Command(position=(1.0, 1.0)))
    bench.wait(3.0)
    assert bench.angles() == pytest.approx(held, abs=STEP_RAD)  # it holds


def test_an_answer_to_an_earlier_request_is_ignored() -> None:
    bench = Emulated()
    bench.guard.connect()
    bench.guard.enable()
    bench.follow(20, (0.3, 0.3))
    losing(bench, torque_off_of(2), late=True)
    with pytest.raises(HardwareError):
        bench.guard.disable()
    assert bench.guard.mode is Mode.FAULT


def test_a_failed_enable_leaves_no_torque_on_unreported() -> None:
    bench = Emulated()
    bench.guard.connect()

    def lose(device: int, instruction: int, parameters: bytes) -> bool:
        arming = parameters[:1] == bytes((reg.WATCHDOG.address,))
        return (device, instruction) == (2, Instruction.WRITE) and arming

    losing(bench, lose)
    with pytest.raises(LinkLost):
        bench.guard.enable()
    assert bench.guard.mode is Mode.FAULT
    assert on(bench) == [False, False]
    with pytest.raises(StateError, match=r"^cannot enable: handle motor 2"):
        bench.guard.enable()


def test_torque_switched_on_by_another_program_is_an_error() -> None:
    bench = Emulated()
    with bench.guard as guard:
        bench.servos[1].write(reg.TORQUE_ENABLE.address, b"\x01")
        text = (
            r"^handle motor 2 \(left_right\) has torque though it was switched off; end any other "
        )
        with pytest.raises(LinkLost, match=text):
            bench.follow(1)
        guard.clear_fault()
        assert on(bench) == [False, False]


def test_torque_switched_off_by_another_program_is_an_error() -> None:
    bench = Emulated()
    with bench.guard as guard:
        guard.enable()
        bench.follow(3)
        bench.servos[1].write(reg.TORQUE_ENABLE.address, b"\x00")
        text = r"^handle motor 2 \(left_right\) was switched off by another program; check plug and"
        with pytest.raises(HardwareError, match=text):
            bench.follow(1)


def test_closing_retries_on_a_silent_line() -> None:
    bench = Emulated()
    bench.guard.connect()
    bench.guard.enable()
    bench.follow(5, (0.3, 0.3))
    back_at = bench.clock.now() + 0.3
    losing(bench, lambda *_: bench.clock.now() < back_at)
    bench.guard.close()
    assert on(bench) == [False, False]


def test_whole_turns_survive_a_recovery_that_fails_half_way() -> None:
    handles = {a: Handle(id=i, zero_counts=3900) for i, a in enumerate(AXES, 1)}
    bench = Emulated(handles=handles)
    with bench.guard as guard:
        guard.enable()
        before = bench.follow(100, (0.5, 0.5))[-1].position
        for number in (1, 2):
            bench.wire.strike("reset", number)
        with pytest.raises(HardwareError):
            bench.follow(1)

        def lose_cycles(_device: int, instruction: int, _parameters: bytes) -> bool:
            return instruction == Instruction.SYNC_READ

        honest = bench.wire.respond
        losing(bench, lose_cycles)
        with pytest.raises(LinkLost, match="does not answer to sync reads"):
            guard.clear_fault()
        bench.wire.respond = honest  # type: ignore[method-assign]
        guard.clear_fault()
        assert guard.enable().position == pytest.approx(before, abs=STEP_RAD)  # droop


@pytest.mark.parametrize(("pause_s", "drift"), [(60.0, -1e-4), (0.35, 0.01), (600.0, 1e-4)])
def test_a_pause_between_exchanges_is_tolerated_despite_clock_drift(
    pause_s: float, drift: float
) -> None:
    bench = Emulated()
    for servo in bench.servos:
        servo.now = lambda: bench.clock.now() * (1 + drift)
    with bench.guard as guard:
        bench.follow(10)
        bench.wait(pause_s)
        assert guard.exchange(None).fresh
        assert bench.follow(1)[0].fresh


def test_after_a_pause_one_lost_answer_is_only_stale() -> None:
    bench = Emulated()
    with bench.guard as guard:
        bench.follow(3)
        bench.wait(0.5)
        lost = iter([True])
        losing(bench, lambda *_: next(lost, False))
        assert not guard.exchange(None).fresh
        assert bench.follow(1)[0].fresh


def test_a_log_ends_where_recording_stops_or_starts_anew(tmp_path: Path) -> None:
    bench = Emulated()
    first, second = tmp_path / "first.log", tmp_path / "second.log"
    with bench.guard:
        bench.bus.record(first)
        bench.follow(3)
        size = first.stat().st_size
        bench.bus.record(second)
        bench.follow(3)
        assert first.stat().st_size == size
        bench.bus.stop_recording()
        bench.bus.stop_recording()  # without effect
        size = second.stat().st_size
        bench.follow(3)
    assert second.stat().st_size == size > 8


def test_a_full_disk_does_not_keep_the_motors_from_stopping(tmp_path: Path) -> None:
    if sys.platform == "win32":
        pytest.skip("Windows has no limit of a file's size")
    bench = Emulated()
    bench.guard.connect()
    bench.guard.enable()
    bench.bus.record(tmp_path / "bus.log")
    bench.follow(5, (0.3, 0.3))
    size = (tmp_path / "bus.log").stat().st_size
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size + 50, hard))
    try:
        bench.follow(20, (0.3, 0.3))  # goes on without the log
        with pytest.raises(ConfigError, match=r"cannot write .*bus\.log: .*; make room"):
            bench.guard.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert on(bench) == [False, False]
