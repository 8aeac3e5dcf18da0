"""What an experiment consists of, once all names and files are loaded."""

from __future__ import annotations

from typing import Any, NamedTuple

from endolock.hw.bench.bench_file import Bench
from endolock.scripts.runs import step_dependence
from endolock.scripts.runs.experiment_checks import Examined
from endolock.twin.world import joint_conditions
from endolock.twin.world.instrument import Instrument, Numerics
from endolock.twin.world.scenario import Scenario


class Resolved(NamedTuple):
    """An experiment with all names and files loaded."""

    scenario: Scenario
    instrument: Instrument
    numerics: Numerics
    settings: Any
    """Settings of the controller; None for an object."""
    known: dict[str, str]
    """What settings follow from, by their names: scenario or instrument."""
    changes: dict[str, Any]
    """Values that differ from the scenario's file, by dotted key."""
    bench: Bench | None
    """Configuration of a serial rig; None for other rigs."""
    examined: Examined
    """What was found out about it before it runs."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know before it runs, each in one line; may simulate for seconds."""
        used = self.scenario, self.instrument, self.numerics
        dependent = step_dependence.note(self.examined.timestep_error_deg, *used)
        found = [*self.examined.without_effect, *joint_conditions.unseen(self.scenario)]
        return (*found, *([dependent] if dependent else []))
