"""One answered question of the thesis, and the runs that the answers are made of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from endolock.scripts.runs.experiment import Experiment

NO_FRICTION = ("no_hysteresis",)
DURATION_S, SCORED_FROM_S = 45.0, 17.2
"""Two complete strokes to settle, then more than three that are scored [s]."""


class Answer(NamedTuple):
    """The answer to one question."""

    table: str
    """Markdown."""
    draw: Callable[[Any], None]
    """Draws the figure into one Matplotlib panel."""


def experiment(scenario: str, controller: str, *changes: str) -> Experiment:
    """Describe one run."""
    return Experiment(
        scenario=scenario,
        controller=controller,
        vision="truth",
        vary=changes,
        duration_s=DURATION_S,
        scored_from_s=SCORED_FROM_S,
        force=True,
    )
