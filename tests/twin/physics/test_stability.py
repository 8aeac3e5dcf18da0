"""A simulation that has diverged ends in one line, whatever its numbers look like."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from endolock.hw.api import Command, ConfigError
from endolock.twin.physics.plant import TwinPlant
from endolock.twin.rig import TwinRig
from endolock.twin.world import scenario
from endolock.twin.world.instrument import Instrument, Numerics
from endolock.twin.world.scenario import Scenario

REST = scenario.load("rest")
DEFAULT = Instrument()


def _plant(instrument: Instrument = DEFAULT) -> TwinPlant:
    return TwinPlant(REST, instrument, Numerics(), 0)


def _nan(plant: TwinPlant) -> None:
    plant.data.qvel[3] = np.nan


def _pushed(plant: TwinPlant) -> None:
    plant.data.xfrc_applied[plant.model.body("tip").id, :3] = 1e13


def _fast(plant: TwinPlant) -> None:
    plant.model.jnt_limited[0] = False
    plant.model.dof_armature[0] = 100.0
    plant.data.qvel[0] = 600.0


def _folded(plant: TwinPlant) -> None:
    plant.model.jnt_stiffness[:] = plant.model.tendon_stiffness[:] = 0.0
    plant.model.dof_damping[:] = 0.0
    plant.data.qpos[4] = 1.7


def _turned(plant: TwinPlant) -> None:
    plant.model.jnt_limited[0] = False
    plant.data.qpos[0] = 9.0


@pytest.mark.parametrize(
    ("disturb", "reason"),
    [
        (_nan, "MuJoCo reset a state that was not finite"),
        (_pushed, "MuJoCo reset a state that was not finite"),
        (_fast, "a joint turns at .* rad/s, which the time step does not resolve"),
        (_folded, "a ring is bent by 9.* deg to the next one, wanted up to 90 deg"),
        (_turned, "a handle is at 8.* rad, beyond its stops"),
    ],
)
def test_every_way_to_diverge_is_noticed_within_10_ms(
    disturb: Callable[[TwinPlant], None], reason: str
) -> None:
    plant = _plant()
    plant.advance(5)
    disturb(plant)
    with pytest.raises(ConfigError, match=rf"diverged before t = 0\.0[12]\d s: {reason}") as caught:
        plant.advance(500)
    assert caught.value.next_step == (
        "use values nearer to those of an endoscope, or smaller forces"
    )
    assert np.isfinite(plant.data.qpos).all()  # so that the numbers alone would not tell


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"bending_stiffness": 1e-6}, r"bending_stiffness 1e-06 \(default 0\.05\)"),
        ({"slack_m": -0.05}, r"slack_m -0\.05 \(default -0\.00375\)"),
        (
            {"bending_stiffness": 1e-6, "tip_mass_kg": 1e-6},
            r"bending_stiffness 1e-06 .*, tip_mass_kg 1e-06",
        ),
    ],
)
def test_a_model_that_the_time_step_does_not_resolve_is_named(
    change: dict[str, float], named: str
) -> None:
    with pytest.raises(ConfigError, match=f"unusual are instrument.{named}"):
        _waved(REST, Instrument(**change))


def test_a_push_of_ten_newtons_at_full_speed_does_not_diverge() -> None:
    pushed = {"start_s": 0.1, "over_s": 0.1, "force_n": 10, "direction_deg": 45}
    _waved(scenario.load(REST, {"push": [pushed], "gravity": True}), DEFAULT)


def _waved(world: Scenario, instrument: Instrument) -> None:
    """Turn the handles to and fro for a second."""
    with TwinRig(world, instrument=instrument, pictures=False) as rig:
        rig.clock.sleep_until(0.0)
        rig.actuators.enable()
        for n in range(1, 50):
            rig.actuators.exchange(Command(position=(0.3, 1.5 * (-1) ** n)))
            rig.clock.sleep_until(0.02 * n)


def test_nothing_is_printed_or_written(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    plant = _plant()
    _nan(plant)
    with pytest.raises(ConfigError):
        plant.advance(5)
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []


def test_the_users_handler_of_warnings_stays() -> None:
    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    try:
        mujoco.set_mju_user_warning(said.append)
        plant = _plant()
        _nan(plant)
        with pytest.raises(ConfigError):
            plant.advance(5)
    finally:
        mujoco.set_mju_user_warning(before)
    assert len(said) == 1


def test_a_model_that_mujoco_refuses_is_one_line() -> None:
    thin = Instrument(
        outer_diameter_m=0.001, wire_radius_m=0.0004, section_mass_kg=1e-6, tip_mass_kg=1e-6
    )
    with pytest.raises(ConfigError, match=r"no model can be built from these values \(.*mass"):
        TwinPlant(Scenario(name="rest"), thin, Numerics(hinges=100), 0)
