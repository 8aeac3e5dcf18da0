"""What is checked of an experiment before it runs: keys without effect, the step, a rig object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from endolock.hw.api import ConfigError, Rig
from endolock.scripts.runs import effects, step_dependence
from endolock.scripts.runs.overrides import Task
from endolock.twin.world.instrument import Numerics


class Examined(NamedTuple):
    """What was found out about an experiment before it runs."""

    timestep_error_deg: float | None = None
    """See `step_dependence.error_deg`."""
    without_effect: tuple[str, ...] = ()
    """What has no effect beside what has one, each in one line."""

    def described(self) -> dict[str, Any]:
        """Return what was measured as plain values for run.toml."""
        error_deg = self.timestep_error_deg
        return {} if error_deg is None else {"timestep_error_deg": error_deg}


def examine(
    rig: str, vision: str, vary: Sequence[str], given: Mapping[str, str], task: Task
) -> Examined:
    """Check that every variation has an effect, and whether results depend on the time step.

    Args:
        rig: name of the rig.
        vision: kind of vision.
        vary: the variations.
        given: the options, or the file, that replace values of the variations, by dotted key.
        task: scenario, instrument and numerics with all changes.

    Raises:
        ConfigError: a variation has no effect.
    """
    setting = effects.Setting(rig, vision, task.scenario, task.instrument, task.plain)
    notes = effects.check(vary, given, setting)
    used = task.scenario, task.instrument, task.numerics
    error_deg = step_dependence.error_deg(rig, *used)
    return Examined(error_deg, notes)


def check_rig(rig: Rig, task: Task, seed: int) -> None:
    """Check that a rig object was made from the same things as the experiment.

    Raises:
        ConfigError: it was made from others.
    """
    if task.numerics != Numerics():
        raise ConfigError("a rig object has its numerics", "leave numerics.NAME out")
    used = {"scenario": task.scenario, "instrument": task.instrument, "seed": seed}
    for name, value in used.items():
        if getattr(rig, name, value) != value:
            raise ConfigError(
                f"the rig was made with another {name}",
                f"give {name}=rig.{name}, and no changes to it",
            )
