"""Whether a run depends on the time step of its simulation, and numerics with which it does not."""

from __future__ import annotations

from functools import cache

from endolock.scripts.runs.rigs import RIGS
from endolock.twin.physics import timestep_check
from endolock.twin.physics.timestep_check import FINER, LIMIT_DEG, UNSTABLE_DEG
from endolock.twin.world import instrument_files, joint_conditions
from endolock.twin.world.instrument import NUMERICS, Instrument, Numerics
from endolock.twin.world.scenario import Scenario

TESTED_DEG = 180.0
"""Largest bend of the shaft at which that is tested [deg]: beyond it, the wires rub harder."""


@cache
def _known() -> frozenset[tuple[Instrument, Numerics]]:
    """Return what needs no check, because a test shows that it converges.

    That is the instruments of the package, with the presets of at most the default's step, up to
    `TESTED_DEG` of the shaft.
    """
    presets = [n for n in NUMERICS.values() if n.timestep_s <= Numerics().timestep_s]
    shipped = [instrument_files.load(name) for name in instrument_files.names()]
    return frozenset((i, n) for i in shipped for n in presets)


def error_deg(
    rig: str, scenario: Scenario, instrument: Instrument, numerics: Numerics
) -> float | None:
    """Return how much bends depend on the step, see `timestep_check.timestep_error_deg` [deg].

    With changes of the friction, it is the largest of those before and after them.

    Args:
        rig: name of the rig.
        scenario: gives bend of the shaft, changes of the friction, and gravity.
        instrument: parameters of the endoscope.
        numerics: resolution of the simulation.

    Returns:
        None where nothing was checked: without physics, and for an instrument of the package with
        the presets `default` and `fidelity`, up to `TESTED_DEG` of the shaft.
    """
    bend_deg, gravity = scenario.shaft_bend_deg, scenario.gravity
    if rig not in RIGS or not RIGS[rig].pictures:
        return None
    checked = [
        timestep_check.timestep_error_deg(made, numerics, bend_deg, gravity)
        for made in joint_conditions.with_friction(scenario, instrument)
        if abs(bend_deg) > TESTED_DEG or (made, numerics) not in _known()
    ]
    return max(checked, default=None)


def note(
    error: float | None, scenario: Scenario, instrument: Instrument, numerics: Numerics
) -> str | None:
    """Return one line about an error above `LIMIT_DEG`, with numerics that converge; else None."""
    if error is None or error <= LIMIT_DEG:
        return None
    step_ms = 1e3 * numerics.timestep_s
    differ = f"differ by {error:.1f} deg" if error < UNSTABLE_DEG else "differ without bound"
    what = (
        f"results depend on the time step: on a fixed drive, bends at {step_ms:g} and "
        f"{step_ms / FINER:g} ms {differ}"
    )
    return f"{what}; {_advice(scenario, instrument, numerics)}"


def _advice(scenario: Scenario, instrument: Instrument, numerics: Numerics) -> str:
    """Say with which numerics an instrument converges, as what to do next."""
    bend_deg, gravity = scenario.shaft_bend_deg, scenario.gravity
    # With several frictions, a step that suits all of them is sought one after another.
    found: Numerics | None = numerics
    for made in joint_conditions.with_friction(scenario, instrument):
        if found is not None:
            found = timestep_check.converging(made, found, bend_deg, gravity)
    if found is None:
        least_ms = 1e3 * timestep_check.SMALLEST_S
        return f"no step down to {least_ms:g} ms converges: use a stiffer section or softer wires"
    return f"--vary numerics.timestep_s={found.timestep_s:g} converges"
