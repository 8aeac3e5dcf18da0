"""Whether the bends of a simulation depend on its time step.

Stiff wires on a soft section, or strong pretension, oscillate faster than a step of some ms
resolves: the motion of the tip then depends on the step. The check turns both handles on a fixed
drive, once with the step and once with a quarter of it, and compares the bends of the tip:

    timestep_error_deg(Instrument(), Numerics())                  # 0.03: results can be believed
    timestep_error_deg(Instrument(slack_m=-0.0375), Numerics())   # 150 N of pretension: 180
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from math import pi

import numpy as np

from endolock.hw.api import AXES, ConfigError, Vector
from endolock.twin.physics.motor import TwinMotor
from endolock.twin.physics.plant import TwinPlant
from endolock.twin.world.instrument import Instrument, Numerics
from endolock.twin.world.scenario import Scenario

LIMIT_DEG = 0.5
"""Largest difference of a bend at which results count as independent of the step [deg]. Assumed:
2 px at f = 262 px, as much as the best controllers leave."""
FINER = 4
"""Ratio of the steps that are compared."""
UNSTABLE_DEG = 180.0
"""Difference where one of the simulations became unstable; larger ones count as this one [deg]."""
HOPELESS = 4.0
"""Ratio of the error expected at the smallest step to the limit, above which no step is tried."""
DURATION_S, PERIOD_S = 3.0, 0.02
CYCLES_S = (8.0, 10.0)
"""Periods of the sines of the two handles [s]: both turn to the end of their range, and one begins
to turn back. Chosen on 19 random instruments, on five of which bends depend on the step by more
than 0.5 deg in a scenario: this drive finds all five, and two more; one of 0.8 rad at 0.5 Hz does
not reach the bends at which one of them does. Faster drives also show the lag of a step, which is
harmless: the wires of `slack` tighten one step later."""
LARGEST_RAD = pi
"""Largest amplitude of the drive [rad]."""
SMALLEST_S = 0.00025
"""Smallest step that is proposed [s]: 8 times as slow as the default of 2 ms."""


@lru_cache(maxsize=512)
def timestep_error_deg(
    instrument: Instrument,
    numerics: Numerics,
    shaft_bend_deg: float = 180.0,
    gravity: bool = False,
) -> float:
    """Return the largest difference of a bend between the step and a quarter of it [deg].

    Args:
        instrument: parameters of the endoscope.
        numerics: resolution of the simulation.
        shaft_bend_deg: bend of the shaft [deg].
        gravity: whether section and tip have weight.
    """
    finer = replace(numerics, timestep_s=numerics.timestep_s / FINER)
    try:
        bends = [_bends(instrument, n, shaft_bend_deg, gravity) for n in (numerics, finer)]
    except ConfigError:
        return UNSTABLE_DEG
    return min(float(np.degrees(np.abs(bends[0] - bends[1]).max())), UNSTABLE_DEG)


def converging(
    instrument: Instrument,
    numerics: Numerics,
    shaft_bend_deg: float = 180.0,
    gravity: bool = False,
) -> Numerics | None:
    """Return the same numerics with the largest step that makes no difference; None without one.

    The step is halved down to `SMALLEST_S`, unless the error, which falls in proportion to the step
    or more slowly, would be several times too large there. Arguments as for `timestep_error_deg`.
    """
    while numerics.timestep_s >= SMALLEST_S - 1e-9:
        error = timestep_error_deg(instrument, numerics, shaft_bend_deg, gravity)
        if error <= LIMIT_DEG:
            return numerics
        if error * SMALLEST_S / numerics.timestep_s > HOPELESS * LIMIT_DEG:
            return None
        numerics = replace(numerics, timestep_s=numerics.timestep_s / 2)
    return None


@lru_cache(maxsize=64)
def _bends(
    instrument: Instrument, numerics: Numerics, shaft_bend_deg: float, gravity: bool
) -> Vector:
    """Return the bends on the drive, one row per control period [rad].

    Raises:
        ConfigError: the simulation became unstable.
    """
    still = Scenario(name="drive", shaft_bend_deg=shaft_bend_deg, gravity=gravity)
    plant = TwinPlant(still, instrument, numerics, seed=0)
    motors = [TwinMotor(plant, axis) for axis in AXES]
    for motor in motors:
        motor.power(True)
    amplitude = min(instrument.handle_range_rad, LARGEST_RAD)
    steps = round(PERIOD_S / plant.timestep_s)
    bends = []
    for t in np.arange(1, round(DURATION_S / PERIOD_S) + 1) * PERIOD_S:
        for motor, cycle_s in zip(motors, CYCLES_S, strict=True):
            motor.aim(amplitude * float(np.sin(2 * pi * t / cycle_s)))
        plant.advance(plant.step_count + steps)
        bends.append(plant.explain(plant.snapshot())[0].bend_rad)
    return np.array(bends)
