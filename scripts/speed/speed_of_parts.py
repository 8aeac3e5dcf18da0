"""Measures the speed of all parts, as ratios to a bound measured in the same minute.

Machines are shared and noisy: each time is the median of interleaved repetitions, and what counts
is the ratio to bare `mj_step`, to a raw OpenGL quad, or to simulated time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from endolock.scripts.speed import (
    environment_speed,
    link_speed,
    picture_speed,
    plant_speed,
    protocol_speed,
    run_speed,
    tick_times,
)

MEASURES: Mapping[str, Callable[[], dict[str, Any]]] = {
    "physics": plant_speed.physics,
    "render": picture_speed.render,
    "vision": picture_speed.vision,
    "pipeline": run_speed.pipeline,
    "surrogate": plant_speed.surrogate,
    "control": tick_times.mean,
    "control_p99": tick_times.p99,
    "link": link_speed.measure,
    "log": run_speed.log,
    "protocols": protocol_speed.protocols,
    "env": environment_speed.environments,
}
"""Measurements by their key in the JSON, in the order they are taken."""


def measure(progress: Callable[[str], None] = lambda _part: None) -> dict[str, dict[str, Any]]:
    """Take all measurements; those of the environments only where Gymnasium is installed.

    Args:
        progress: called with the key of each measurement before it is taken.

    Returns:
        Figures by name, by the keys of `MEASURES`.
    """
    figures = {}
    for name, part in MEASURES.items():
        if name == "env" and not environment_speed.available():
            continue
        progress(name)
        figures[name] = part()
    return figures
