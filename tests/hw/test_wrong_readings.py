"""A servo that tells wrong positions, with good checksums, moves no handle.

Whatever one or two readings of a motor say, in whichever cycles of whichever event: a handle that
rests without a load truly stays, to two counts of its encoder.
"""

from __future__ import annotations

import random
import secrets
from collections.abc import Callable, Mapping
from contextlib import suppress

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from tests.hw.emulated import PERIOD_S, START, STEP_RAD, Emulated

from endolock.hw.api import Command, DeviceFault, HardwareError, Mode, StateError
from endolock.hw.dynamixel import registers as reg
from endolock.hw.emulator.servo_model import Servo
from endolock.hw.emulator.wire_faults import WireFault
from endolock.hw.guard import Guard
from endolock.twin.rig import TwinRig

HERE = (0.0, 0.0)
"""Where the handles of the bench stand [rad]: their zeros are set there."""
STAYS_RAD = 2 * STEP_RAD * 1.001
BLOCK = (reg.INDIRECT_DATA.address, reg.BLOCK_SIZE)


class Liar:
    """Adds errors to the positions that a servo tells in its cycles."""

    def __init__(self, servo: Servo) -> None:
        self._honest = servo.read
        self._cycle = 0
        self._errors: Mapping[int, int] = {}
        servo.read = self._read  # type: ignore[method-assign]  # it is the servo that is on trial

    def lie(self, errors: Mapping[int, int]) -> None:
        """From now on, add these errors [counts], by the number of the cycle."""
        self._cycle, self._errors = 0, errors

    def _read(self, address: int, size: int) -> bytes:
        data = self._honest(address, size)
        if (address, size) != BLOCK:
            return data
        error = self._errors.get(self._cycle, 0)
        self._cycle += 1
        position = reg.POSITION.decode(data[-4:]) + error
        return data[:-4] + position.to_bytes(4, "little", signed=True)


class Bench:
    """An emulated bench with a lying motor, and the largest true distance from the start."""

    def __init__(self, liar: int) -> None:
        self.bench = Emulated()
        self.guard = self.bench.guard
        self.other = self.bench.servos[1 - liar]
        self.liar = Liar(self.bench.servos[liar])
        self.furthest_rad = 0.0

    def look(self) -> None:
        """Note where the handles really are, and where they will be if they are driven."""
        for motor, start in zip(self.bench.motors, START, strict=True):
            at = motor.goal_rad if motor.on else motor.measure()[0]
            self.furthest_rad = max(self.furthest_rad, abs(at - start))

    def go_on(self, n: int, command: Command | None = None) -> None:
        """Exchange this number of times; errors are raised and do not end it."""
        for _ in range(n):
            self.bench.wait(PERIOD_S)
            with suppress(HardwareError):
                self.guard.exchange(command)
            self.look()

    def ready(self) -> None:
        """Connect and enable, without lies, and stay."""
        self.guard.connect()
        self.guard.enable()
        self.go_on(6, Command(position=HERE))


def _connect(bench: Bench, lie: Callable[[], None]) -> None:
    lie()
    bench.guard.connect()
    bench.guard.enable()


def _enable(bench: Bench, lie: Callable[[], None]) -> None:
    bench.guard.connect()
    lie()
    bench.guard.enable()


def _exchange(bench: Bench, lie: Callable[[], None]) -> None:
    bench.ready()
    lie()


def _hold(bench: Bench, lie: Callable[[], None]) -> None:
    bench.ready()
    lie()
    bench.guard.hold()
    bench.go_on(10)


def _estop(bench: Bench, lie: Callable[[], None]) -> None:
    bench.ready()
    bench.guard.estop("tried")
    lie()
    bench.go_on(3)


def _lies_before_estop(bench: Bench, lie: Callable[[], None]) -> None:
    bench.ready()
    lie()
    bench.go_on(2, Command(position=HERE))
    bench.guard.estop("tried")
    bench.go_on(3)


def _fault_of_the_other(bench: Bench, lie: Callable[[], None]) -> None:
    bench.ready()
    bench.other.fail("overload")
    lie()
    bench.go_on(3)


def _watchdog(bench: Bench, lie: Callable[[], None]) -> None:
    bench.ready()
    bench.bench.wait(0.5)
    lie()
    bench.go_on(3)


def _link_lost(bench: Bench, lie: Callable[[], None]) -> None:
    bench.ready()
    bench.other._started = 1e9
    lie()
    bench.go_on(20, Command(position=HERE))
    bench.other._started = 0.0


def _disable(bench: Bench, lie: Callable[[], None]) -> None:
    bench.ready()
    lie()
    bench.guard.disable()
    bench.go_on(2)
    bench.guard.enable()


def _lies_before_disable(bench: Bench, lie: Callable[[], None]) -> None:
    bench.ready()
    lie()
    bench.go_on(2, Command(position=HERE))
    bench.guard.disable()
    bench.guard.enable()


def _clear_fault(bench: Bench, lie: Callable[[], None]) -> None:
    bench.ready()
    bench.guard.estop("tried")
    bench.go_on(1)
    lie()
    bench.guard.clear_fault()
    bench.guard.enable()


def _lies_before_a_restart(bench: Bench, lie: Callable[[], None]) -> None:
    bench.ready()
    lie()
    bench.go_on(2, Command(position=HERE))
    for number in (1, 2):
        bench.bench.wire.strike("reset", number)
    bench.go_on(1)
    bench.guard.clear_fault()
    bench.guard.enable()


EVENTS = [
    _connect,
    _enable,
    _exchange,
    _hold,
    _estop,
    _lies_before_estop,
    _fault_of_the_other,
    _watchdog,
    _link_lost,
    _disable,
    _lies_before_disable,
    _clear_fault,
    _lies_before_a_restart,
]
ERRORS = st.one_of(
    st.sampled_from([-reg.TURN, reg.TURN, -700, 4, 30, 60]),
    st.integers(-80, 80),  # as far as a handle may turn within a period
    st.integers(-3 * reg.TURN, 3 * reg.TURN),
)


@pytest.mark.parametrize("event", EVENTS)
@settings(max_examples=25, derandomize=True, phases=[Phase.generate])
@given(
    liar=st.integers(0, 1),
    errors=st.dictionaries(st.integers(0, 9), ERRORS, min_size=1, max_size=2),
)
def test_two_wrong_readings_move_no_handle(
    event: Callable[[Bench, Callable[[], None]], None], liar: int, errors: dict[int, int]
) -> None:
    bench = Bench(liar)
    with suppress(HardwareError):
        event(bench, lambda: bench.liar.lie(errors))
    bench.look()
    bench.go_on(12, Command(position=HERE) if bench.guard.mode.driven else None)
    assert bench.furthest_rad <= STAYS_RAD


Event = Callable[[Bench, Callable[[], None]], None]


def try_lossy(event: Event, count: int, seed: int) -> None:
    """Tell one or two wrong positions on a line that damages, delays or loses packets."""
    chance = random.Random(seed)
    for _ in range(count):
        bench = Bench(chance.randrange(2))
        bench.bench.wire._random.seed(chance.random())
        wire = WireFault(
            kind=chance.choice(["drop", "late", "truncate", "lost"]),
            share=chance.choice([0.05, 0.15]),
        )
        sizes = [-reg.TURN, reg.TURN, -700, 30, chance.randint(-80, 80)]
        wrong = {chance.randrange(10): chance.choice(sizes) for _ in range(chance.randint(1, 2))}

        def lie(
            bench: Bench = bench, wire: WireFault = wire, wrong: dict[int, int] = wrong
        ) -> None:
            bench.liar.lie(wrong)
            bench.bench.wire.add(wire)

        with suppress(HardwareError):
            event(bench, lie)
        bench.look()
        bench.go_on(12, Command(position=HERE) if bench.guard.mode.driven else None)
        assert bench.furthest_rad <= STAYS_RAD, (wire, wrong)


@pytest.mark.parametrize("event", EVENTS)
def test_nor_do_they_on_a_line_that_loses_packets(event: Event) -> None:
    try_lossy(event, count=3, seed=0)


@pytest.mark.slow
@pytest.mark.parametrize("event", EVENTS)
def test_nor_do_they_in_many_cases_on_such_a_line(event: Event) -> None:
    seed = secrets.randbelow(2**32)
    print(f"seed {seed}")
    try_lossy(event, count=100, seed=seed)


def test_a_wrong_zero_is_not_taken_at_home() -> None:
    for cycles in ((0, 1), (0, 3), (2, 4), (4, 5)):
        for errors in ((-4096, -4096), (700, -300), (40, 40)):
            bench = Bench(0)
            bench.guard.connect()
            bench.liar.lie(dict(zip(cycles, errors, strict=True)))
            bench.guard.home()
            bench.guard.enable()
            bench.go_on(12, Command(position=(0.0, 0.0)))
            assert bench.furthest_rad <= STAYS_RAD


@pytest.mark.parametrize("error", [-4096, 4096, 700, -400])
@pytest.mark.parametrize("event", [_exchange, _hold, _estop, _fault_of_the_other, _link_lost])
def test_a_position_that_stays_wrong_stops_driven_handles_where_they_are(
    event: Callable[[Bench, Callable[[], None]], None], error: int
) -> None:
    bench = Bench(0)
    event(bench, lambda: bench.liar.lie(dict.fromkeys(range(1000), error)))
    bench.go_on(30)
    assert bench.furthest_rad <= STAYS_RAD
    assert bench.guard.mode is Mode.FAULT
    with pytest.raises(HardwareError):
        bench.guard.exchange(None)


def test_one_wrong_reading_is_a_state_that_is_not_fresh() -> None:
    bench = Bench(1)
    bench.ready()
    bench.liar.lie({0: -4096, 3: 900})
    for n in range(6):
        bench.bench.wait(PERIOD_S)
        state = bench.guard.exchange(Command(position=HERE))
        assert state.fresh == (n not in (0, 3))
        assert state.position == pytest.approx(HERE, abs=STEP_RAD)  # the last one that was right
    assert bench.guard.mode is Mode.ENABLED


def test_three_wrong_readings_in_a_row_are_a_fault_with_its_axis() -> None:
    bench = Bench(1)
    bench.ready()
    bench.liar.lie(dict.fromkeys(range(1000), 2000))
    with pytest.raises(DeviceFault, match=r"^handle left_right reads \+3\.07 rad, where") as e:
        bench.bench.follow(3, HERE)
    assert (e.value.kind, e.value.axis) == ("encoder", "left_right")


@pytest.mark.parametrize("call", ["enable", "home"])
def test_readings_that_never_agree_are_refused_and_nothing_is_latched(call: str) -> None:
    bench = Bench(0)
    bench.guard.connect()
    bench.liar.lie({n: 100 * n * n for n in range(1, 1000)})
    with pytest.raises(DeviceFault, match=r"^12 readings of handle up_down do not agree, so "):
        getattr(bench.guard, call)()
    assert not any(motor.on for motor in bench.bench.motors)
    bench.liar.lie({})
    assert bench.guard.mode is Mode.DISABLED
    getattr(bench.guard, call)()


def test_positions_that_never_agree_are_refused_at_connect() -> None:
    bench = Bench(0)
    bench.liar.lie({n: 500 * n for n in range(5)})
    bench.guard.connect()
    text = (
        r"^cannot enable: handle motor 1 \(up_down\) reads 2048, 2548, 3048, 3548, 4048 counts in "
    )
    with pytest.raises(StateError, match=text):
        bench.guard.enable()
    assert not any(motor.on for motor in bench.bench.motors)
    bench.guard.clear_fault()
    bench.guard.enable()


@pytest.mark.parametrize("event", ["enable", "exchange", "hold", "estop", "connect"])
@pytest.mark.parametrize("errors", [{0: -4096, 2: -4096}, {1: 30, 2: 45}])
def test_the_twin_does_not_believe_them_either(event: str, errors: dict[int, int]) -> None:
    rig = TwinRig("rest", pictures=False)
    guard: Guard = rig.actuators
    liar = Liar(rig.servos[0])
    joint = rig.plant.model.joint("handle_up_down").qposadr[0]
    start = float(rig.plant.data.qpos[joint])
    if event == "connect":
        liar.lie(errors)
    guard.connect()
    if event == "enable":
        liar.lie(errors)
    guard.enable()
    for n in range(20):
        rig.clock.sleep_until(rig.clock.now() + PERIOD_S)
        if n == 6 and event not in ("enable", "connect"):
            liar.lie(errors)
            if event == "hold":
                guard.hold()
            if event == "estop":
                guard.estop("tried")
        with suppress(DeviceFault):
            guard.exchange(None)
        # Unloaded, but for the weight of nothing: two counts of the twin's encoder.
        assert abs(float(rig.plant.data.qpos[joint]) - start) <= 2 * rig.instrument.encoder_step_rad
    rig.close()
