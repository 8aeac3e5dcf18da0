"""The size of recordings, measured on a short one."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

from endolock.hw.api import ConfigError

RECORDED_S = 1.0
"""Time between the first frame and the end of the recording [s]."""


def mb_per_min() -> tuple[float, str]:
    """Run the twin for a moment as `endolock run` does, and weigh the folder.

    Returns:
        Growth of a run folder with its run.rrd [MB/min], and of what runs: "with pictures", or
        "without pictures" where they cannot be drawn here.
    """
    try:
        return _measured("markers"), "with pictures"
    except ConfigError:
        return _measured("truth"), "without pictures"


def _measured(vision: str) -> float:
    from endolock.scripts.figures import rerun_export  # and with it Rerun
    from endolock.scripts.runs.experiment import Experiment

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "run"
        plan = Experiment(scenario="straight", vision=vision, out=folder)
        duration_s = plan.resolve().scenario.camera.latency_s + RECORDED_S
        replace(plan, duration_s=duration_s).run()
        rerun_export.derive(folder)
        size = sum(file.stat().st_size for file in folder.iterdir())
    return size / 1e6 * 60 / RECORDED_S
