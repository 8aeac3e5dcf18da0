"""A check of `endolock doctor`: whether the simulation converges on this machine."""

from __future__ import annotations

from endolock.scripts.commands.doctor.finding import Finding


def numerics() -> Finding:
    """Compare bends at the step of the default numerics, and of faster ones, with a quarter."""
    from endolock.twin.physics.timestep_check import LIMIT_DEG, timestep_error_deg
    from endolock.twin.world.instrument import NUMERICS, Instrument

    errors = {
        name: timestep_error_deg(Instrument(), NUMERICS[name]) for name in ("default", "fast")
    }
    found = ", ".join(f"{name} ({error:.2f} deg)" for name, error in errors.items())
    text = f"bends at the time step and a quarter of it: {found}; at most {LIMIT_DEG:g} deg"
    bad = [name for name, error in errors.items() if error > LIMIT_DEG]
    advice = f"do not use {', '.join(bad)}; --vary numerics.timestep_s=0.001" if bad else ""
    return Finding("numerics", not bad, text, advice)
