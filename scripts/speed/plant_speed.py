"""Speed of the plants: the physics of the twin, and the surrogate."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from endolock.control import loop, registry
from endolock.hw.api import Command
from endolock.scripts.speed.median_times import median_times
from endolock.twin.rig import TwinRig
from endolock.twin.surrogate import SurrogateRig
from endolock.twin.world.fitted_plays import plays_of
from endolock.twin.world.instrument import NUMERICS, Instrument, Numerics
from endolock.vision.truth_eyes import TruthEyes

SLICE_S = 2.0
"""Simulated time of one physics measurement [s]."""
RUN_S = 10.0
"""Simulated time of one run of the surrogate [s]."""


def physics() -> dict[str, Any]:
    """Measure simulated seconds per second of bare `mj_step` and of the twin's clock."""
    bare_s, wrapped_s = _physics(NUMERICS["default"])
    figures = {
        "real_time_factor": SLICE_S / wrapped_s,
        "bare_real_time_factor": SLICE_S / bare_s,
        "wrapper_over_bare": wrapped_s / bare_s,
        "numerics": "default",
    }
    for name in ("fast", "fidelity"):
        figures[f"{name}_real_time_factor"] = SLICE_S / _physics(NUMERICS[name])[1]
    return figures


def _physics(numerics: Numerics) -> tuple[float, float]:
    """Return the wall times of one slow motion of `SLICE_S`, bare steps and whole twin [s]."""
    rig = TwinRig("straight", numerics=numerics, pictures=False)
    plant = rig.plant
    ticks = round(SLICE_S / 0.020)
    per_tick = round(0.020 / plant.timestep_s)
    commands = np.sin(np.linspace(0, 2 * np.pi, ticks))[:, None] * [0.2, 0.4]

    def bare() -> None:
        for command in commands:
            plant.data.ctrl[:] = command
            mujoco.mj_step(plant.model, plant.data, per_tick)

    def wrapped() -> None:
        for command in commands:
            plant.data.ctrl[:] = command
            rig.clock.sleep_until(rig.clock.now() + 0.020)

    with rig:
        rig.actuators.enable()
        bare_s, wrapped_s = median_times(bare, wrapped)
    return bare_s, wrapped_s


def surrogate() -> dict[str, float]:
    """Measure simulated seconds per second of the surrogate, driven directly and by `pi`."""
    plays = plays_of(Instrument(), 180.0)

    def driven() -> None:
        with SurrogateRig("straight", transmission=plays) as rig:
            rig.actuators.enable()
            for n in range(round(RUN_S / 0.020)):
                rig.clock.sleep_until(0.020 * n)
                rig.actuators.exchange(Command(position=(0.1, 0.001 * n)))
                rig.camera.latest()

    def locked() -> None:
        with SurrogateRig("straight", transmission=plays) as rig:
            law = registry.make("pi", rig.camera.calibration)
            loop.run(rig, TruthEyes(rig.truth), law, duration_s=RUN_S)

    rig_s, loop_s = median_times(driven, locked)
    return {"rig_rtf": RUN_S / rig_s, "loop_rtf": RUN_S / loop_s}
