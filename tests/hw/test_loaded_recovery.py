"""What a loaded handle does as torque comes back: docs/safety.md states it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from math import exp
from pathlib import Path

import pytest
from tests.hw.emulated import PERIOD_S, STEP_RAD, Emulated, LagMotor

from endolock.hw.api import AXES, Command, DeviceFault
from endolock.hw.positions import LOAD_RAD
from endolock.twin.rig import TwinRig

SAG = 4
"""How far a load pulls a handle off its goal [counts], as the twin's wires do."""
BACK_RAD_S = 0.02
"""Speed at which the load turns the gear back without torque [rad/s]."""
SAFETY = Path(__file__).parents[2] / "docs" / "safety.md"


class LoadedMotor(LagMotor):
    """A motor whose load keeps it off its goal, and turns it back where there is no torque."""

    sag = SAG

    def measure(self) -> tuple[float, float, float]:
        """Return angle, speed and current."""
        now = self._clock.now()
        if self.on:
            rest = self.goal_rad - self.sag * STEP_RAD
            self.angle_rad = rest + (self.angle_rad - rest) * exp((self._at - now) / self.lag_s)
        else:
            self.angle_rad -= BACK_RAD_S * (now - self._at)
        self._at = now
        return self.angle_rad, 0.0, self.load_a


class Loaded(Emulated):
    """A bench with such motors, enabled, at rest away from the zeros."""

    def __init__(self) -> None:
        super().__init__()
        for servo, motor in zip(self.servos, self.motors, strict=True):
            servo._motor = LoadedMotor(self.clock, motor.angle_rad)
        self.motors = [servo._motor for servo in self.servos]  # type: ignore[misc]
        self.guard.connect()
        self.guard.enable()
        self.follow(60, (0.3, -0.2))

    def counts(self) -> list[float]:
        """Return where the handles are [counts]."""
        return [motor.measure()[0] / STEP_RAD for motor in self.motors]

    def moved(self, before: list[float]) -> float:
        """Return the larger way of the handles since then [counts]."""
        return max(abs(a - b) for a, b in zip(self.counts(), before, strict=True))


@pytest.fixture
def loaded() -> Iterator[Loaded]:
    """Load both handles."""
    bench = Loaded()
    with bench.guard:
        yield bench


def stop(bench: Loaded) -> None:
    """Press the button, and see it."""
    bench.guard.estop("tried")
    with pytest.raises(DeviceFault):
        bench.follow(1)


def furthest(bench: Loaded, before: list[float], n: int) -> float:
    """Go on; return how far the handles were away meanwhile [counts]."""
    ways = []
    for _ in range(n):
        bench.follow(1)
        ways.append(bench.moved(before))
    return max(ways)


def test_a_hold_does_not_let_a_loaded_handle_sag(loaded: Loaded) -> None:
    before = loaded.counts()
    stop(loaded)
    loaded.wait(0.3)  # the watchdog has not stopped them yet
    assert loaded.moved(before) < 1


def test_a_loaded_handle_stays_as_torque_comes_back(loaded: Loaded) -> None:
    before = loaded.counts()
    stop(loaded)
    loaded.guard.clear_fault()
    loaded.guard.enable()
    assert furthest(loaded, before, 50) <= 1.5  # a count, and half of rounding
    loaded.guard.disable()
    loaded.guard.enable()
    assert furthest(loaded, before, 50) <= 2.5  # the same once more


def test_the_watchdog_costs_a_sag_and_time_without_torque_the_way_back(loaded: Loaded) -> None:
    before = loaded.counts()
    stop(loaded)
    loaded.wait(1.0)
    assert loaded.moved(before) == pytest.approx(SAG, abs=1)  # stopped where it is, it sags
    loaded.guard.clear_fault()
    loaded.wait(0.1)
    off = loaded.counts()
    assert loaded.moved(before) == pytest.approx(SAG + 0.1 * BACK_RAD_S / STEP_RAD, abs=1)
    loaded.guard.enable()
    assert furthest(loaded, off, 50) <= 1.5  # and from there it stays


def test_a_handle_that_has_gone_back_far_sags_once(loaded: Loaded) -> None:
    stop(loaded)
    loaded.guard.clear_fault()
    loaded.wait(3.0)
    off = loaded.counts()
    loaded.guard.enable()
    assert furthest(loaded, off, 50) == pytest.approx(SAG, abs=1)


def test_a_load_that_has_gone_costs_at_most_what_it_needed(loaded: Loaded) -> None:
    stop(loaded)
    loaded.guard.clear_fault()
    for motor in loaded.motors:
        assert isinstance(motor, LoadedMotor)
        motor.sag = 0
    off = loaded.counts()
    loaded.guard.enable()
    assert furthest(loaded, off, 50) == pytest.approx(SAG, abs=1.5)
    assert SAG * STEP_RAD <= LOAD_RAD  # the most that docs/safety.md states
    assert f"at most {LOAD_RAD:g} rad" in SAFETY.read_text()


def test_the_page_states_what_is_measured() -> None:
    sags = re.findall(r"(\d+) counts \(\d\.\d+ deg\)", SAFETY.read_text())
    assert sags
    assert set(map(int, sags)) == {SAG}


def test_the_twins_wires_do_not_move_its_handles_as_torque_comes_back() -> None:
    with TwinRig("rest", pictures=False) as rig:
        guard, step_rad = rig.actuators, rig.instrument.encoder_step_rad
        joints = [rig.plant.model.joint(f"handle_{axis}").qposadr[0] for axis in AXES]

        def rest(n: int) -> list[float]:
            """Go on; return the true angles of the handles [steps of the encoder]."""
            for _ in range(n):
                rig.clock.sleep_until(rig.clock.now() + PERIOD_S)
                guard.exchange(Command(position=(0.4, -0.3)) if guard.mode.driven else None)
            return [float(rig.plant.data.qpos[joint]) / step_rad for joint in joints]

        guard.enable()
        before = rest(80)
        lead = max(abs(goal / step_rad - at) for goal, at in zip((0.4, -0.3), before, strict=True))
        assert lead == pytest.approx(SAG, abs=1)  # which it would sag by
        guard.estop("tried")
        with pytest.raises(DeviceFault):
            rest(1)
        guard.clear_fault()
        guard.enable()
        for _ in range(20):
            rig.clock.sleep_until(rig.clock.now() + PERIOD_S)
            guard.exchange(None)
            there = [float(rig.plant.data.qpos[joint]) / step_rad for joint in joints]
            assert max(abs(a - b) for a, b in zip(there, before, strict=True)) <= 1.5


def test_an_unloaded_handle_is_enabled_where_it_stands() -> None:
    bench = Emulated()
    with bench.guard as guard:
        guard.enable()
        bench.follow(60, (0.3, -0.2))
        before = bench.angles()
        guard.disable()
        state = guard.enable()
        assert state.goal == state.position
        bench.wait(PERIOD_S)
        assert bench.angles() == pytest.approx(before, abs=STEP_RAD)
