"""A check of `endolock doctor`: how many hours of runs fit on the disk, from a short recording."""

from __future__ import annotations

import os
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

from endolock.hw.api import ConfigError
from endolock.scripts.commands.doctor.finding import Finding

RECORDED_S = 1.0
"""Time between the first frame and the end of the recording [s]."""


def disk() -> Finding:
    """Check the free space where runs/ is, or would be created."""
    folder = Path("runs") if Path("runs").is_dir() else Path()
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(f"cannot write to {folder.resolve()}")
    free = shutil.disk_usage(folder).free
    try:
        return room(free, folder.resolve(), *mb_per_min())
    except (ImportError, AttributeError, RuntimeError, ConfigError):  # other checks say why
        text = f"{free / 1e9:.1f} GB free in {folder.resolve()}; no run could be measured here"
        return Finding("disk", True, text)


def room(free_bytes: int, folder: Path, mb_per_min: float, kind: str) -> Finding:
    """Judge the free space [bytes]: an hour of run folders must fit.

    Args:
        free_bytes: free space [bytes].
        folder: where it is.
        mb_per_min: measured growth of a run folder [MB/min].
        kind: of what runs, in words.
    """
    hours = free_bytes / 1e6 / mb_per_min / 60
    text = f"{free_bytes / 1e9:.1f} GB free in {folder}, for {hours:.1f} h of runs {kind}"
    if hours >= 1:
        return Finding("disk", True, text)
    needed = f"an hour takes {60 * mb_per_min / 1e3:.1f} GB"
    return Finding("disk", False, text, f"{needed}: make room, or give --out on another disk")


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
