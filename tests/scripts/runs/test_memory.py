"""A run needs no more memory the longer it lasts, but for the few numbers that it is scored by."""

import os
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

from endolock import SurrogateRig, TwinRig
from endolock.control import loop, metrics, registry
from endolock.scripts.runs.run_folder import RunFolder
from endolock.twin.world.scenario import load
from endolock.vision.truth_eyes import TruthEyes


def resident_mb() -> float:
    """Memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def run(
    rig: SurrogateRig | TwinRig, folder: Path, duration_s: float, each: Callable[[float], None]
) -> None:
    """Run as an experiment does: into a folder, scored while it goes on."""
    camera = rig.camera.calibration
    scorer, controller = metrics.Scorer(camera, 0.0), registry.make("pi", camera)
    with rig, RunFolder(folder, rig.describe()) as recorder:
        loop.run(
            rig,
            TruthEyes(rig.truth),
            controller,
            duration_s=duration_s,
            recorder=loop.Recorders(recorder, scorer),
            keep=False,
            progress=each,
        )
    assert scorer.scores().frames > 20 * duration_s


def test_a_tick_leaves_only_the_numbers_that_it_is_scored_by(tmp_path: Path) -> None:
    held: dict[int, int] = {}

    def look(t: float) -> None:
        if round(t, 6) in (8.0, 12.0):
            held[round(t)] = tracemalloc.get_traced_memory()[0]

    scenario = load("circle").model_copy(update={"duration_s": 20.0})
    tracemalloc.start()
    try:
        run(SurrogateRig(scenario), tmp_path / "run", 12.0, look)
    finally:
        tracemalloc.stop()
    per_s = (held[12] - held[8]) / 4
    # 7 numbers per tick and 2 per frame are 3 kB/s; whole ticks and frames take 200 kB/s. The rest
    # is the guard's history, which fills up.
    assert per_s < 60e3


@pytest.mark.slow
def test_memory_stays_within_5_percent_over_30_minutes(tmp_path: Path) -> None:
    held: dict[int, float] = {}

    def look(t: float) -> None:
        if t >= 60.0 * (len(held) + 1) - 1e-6:
            held[round(t)] = resident_mb()

    scenario = load("circle").model_copy(update={"duration_s": 1801.0})
    run(TwinRig(scenario, pictures=False), tmp_path / "run", 1801.0, look)
    assert max(held) >= 1800
    assert max(held.values()) < 1.05 * held[60]
