"""The check whether bends depend on the time step."""

from __future__ import annotations

import secrets
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from endolock.hw.api import AXES
from endolock.scripts.runs import step_dependence
from endolock.twin.physics.motor import TwinMotor
from endolock.twin.physics.plant import TwinPlant
from endolock.twin.physics.timestep_check import LIMIT_DEG, converging, timestep_error_deg
from endolock.twin.world import instrument_files, scenario
from endolock.twin.world.instrument import NUMERICS, Instrument, Numerics

STIFF = [
    {"slack_m": -0.0375},  # 150 N of pretension
    pytest.param({"wire_stiffness": 4e4}, marks=pytest.mark.slow),  # the same
    {"bending_stiffness": 1e-3},
]


@pytest.mark.parametrize("name", instrument_files.names())
def test_what_comes_with_the_package_converges(name: str) -> None:
    """So runs with it need no check."""
    instrument, rest = instrument_files.load(name), scenario.load("rest")
    assert timestep_error_deg(instrument, Numerics(), rest.shaft_bend_deg) < LIMIT_DEG
    assert step_dependence.error_deg("twin", rest, instrument, Numerics()) is None
    assert step_dependence.error_deg("twin", rest, instrument, NUMERICS["fast"]) is not None


@pytest.mark.slow
@pytest.mark.parametrize("shaft_deg", [0.0, 90.0, step_dependence.TESTED_DEG])
@pytest.mark.parametrize("numerics", ["default", "fidelity"])
@pytest.mark.parametrize("name", instrument_files.names())
def test_all_presets_that_need_no_check_converge(
    name: str, numerics: str, shaft_deg: float
) -> None:
    instrument = instrument_files.load(name)
    for gravity in (False, True):
        error = timestep_error_deg(instrument, NUMERICS[numerics], shaft_deg, gravity)
        assert error < LIMIT_DEG


def test_a_shaft_bent_further_is_checked() -> None:
    """There `two_region` depends on the step, by a little more than the limit."""
    looped = scenario.load("rest", {"shaft_bend_deg": 540.0})
    used = looped, instrument_files.load("two_region"), Numerics()
    error = step_dependence.error_deg("twin", *used)
    assert error is not None
    assert error > LIMIT_DEG


@pytest.mark.parametrize("changes", STIFF)
def test_stiff_wires_on_a_soft_section_depend_on_the_step(changes: dict[str, float]) -> None:
    error = timestep_error_deg(replace(Instrument(), **changes), Numerics())
    assert error > 10  # degrees: 14 to 180 on this drive


def test_a_smaller_step_is_found_where_one_converges() -> None:
    slack, fast = instrument_files.load("slack"), NUMERICS["fast"]
    assert timestep_error_deg(slack, fast) > LIMIT_DEG
    found = converging(slack, fast)
    assert found == replace(fast, timestep_s=0.0025)
    assert timestep_error_deg(slack, found) <= LIMIT_DEG


def test_none_is_named_where_none_converges() -> None:
    assert converging(Instrument(slack_m=-0.0375), Numerics()) is None


def test_a_step_that_converges_is_proposed_as_it_is_given() -> None:
    slack, fast, rest = instrument_files.load("slack"), NUMERICS["fast"], scenario.load("rest")
    error = step_dependence.error_deg("twin", rest, slack, fast)
    said = step_dependence.note(error, rest, slack, fast)
    assert said is not None
    assert "bends at 5 and 1.25 ms differ by 0." in said
    assert said.endswith("; --vary numerics.timestep_s=0.0025 converges")
    assert step_dependence.note(LIMIT_DEG, rest, slack, fast) is None


def test_an_unstable_simulation_says_and_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert timestep_error_deg(Instrument(bending_stiffness=1.1e-4), Numerics()) == 180.0
    assert capfd.readouterr().err == ""
    assert list(tmp_path.iterdir()) == []  # no MUJOCO_LOG.TXT


def plausible(random: np.random.Generator) -> Instrument:
    """Draw an instrument: sizes, stiffness and pretension of up to 150 N as they might be built."""

    def between(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    diameter, wire = between(0.005, 0.014), between(1e3, 4e4)
    tight = random.random() < 0.75
    return Instrument(
        bending_length_m=between(0.03, 0.15),
        outer_diameter_m=diameter,
        wire_radius_m=diameter * random.uniform(0.3, 0.47),
        bending_stiffness=between(0.003, 0.5),
        damping_time_s=between(1e-3, 0.01),
        section_mass_kg=between(0.002, 0.05),
        tip_mass_kg=between(0.0005, 0.02),
        wire_stiffness=wire,
        slack_m=-min(between(1, 150) / wire, 0.05) if tight else random.uniform(0, 0.002),
        conduit_friction=random.uniform(0, 0.4),
        section_friction=random.uniform(0, 0.4),
        pulley_radius_m=between(0.003, 0.01),
    )


@pytest.mark.slow
def test_instruments_that_pass_do_not_depend_on_the_step_in_slow_tracking() -> None:
    """On another motion, as of a scenario: within its range, and as slow."""
    seed = secrets.randbits(32)
    print(f"seed {seed}")
    random = np.random.default_rng(seed)
    passed = [
        i
        for i in (plausible(random) for _ in range(12))
        if timestep_error_deg(i, Numerics()) <= LIMIT_DEG
    ]
    assert passed
    for instrument in passed:
        bends = [_circling(instrument, step) for step in (0.002, 0.0005)]
        # twice the limit: another motion may show somewhat more
        assert np.degrees(np.abs(bends[0] - bends[1])).max() < 2 * LIMIT_DEG, instrument


def _circling(instrument: Instrument, timestep_s: float) -> np.ndarray:
    plant = TwinPlant(scenario.load("rest"), instrument, Numerics(timestep_s=timestep_s), 0)
    motors = [TwinMotor(plant, axis) for axis in AXES]
    for motor in motors:
        motor.power(True)
    bends = []
    for t in np.arange(0.02, 10.0, 0.02):
        for motor, shift in zip(motors, (0.0, 1.3), strict=True):
            motor.aim(0.8 * float(np.sin(2 * np.pi * t / 9 + shift) - np.sin(shift)))
        plant.advance(round(t / timestep_s))
        bends.append(plant.explain(plant.snapshot())[0].bend_rad)
    return np.array(bends)
