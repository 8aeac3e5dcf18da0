"""Speed of whole runs, and of writing their folders."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

from endolock.control import loop, registry
from endolock.control.loop import Seen
from endolock.scripts.runs import run_folder
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.speed.median_times import median_times
from endolock.twin.rig import TwinRig
from endolock.vision.marker_eyes import MarkerEyes

RUN_S = 10.0
"""Simulated time of one run [s]."""


def pipeline() -> dict[str, Any]:
    """Measure simulated seconds per second of `straight`, and of `endoscope` with all its optics.

    The first two runs write no run folder.
    """
    return {
        "pinhole_rtf": _unlogged("straight"),
        "fisheye_rtf": _unlogged("endoscope"),
        "logged_rtf": _run("markers"),
        "truth_rtf": _run("truth"),
    }


def log() -> dict[str, float]:
    """Measure the time to write one frame with both pictures, and the growth of the run folder.

    Growth is averaged over the frames of a run, without the delay of the first frame.
    """
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "run"
        record = Experiment(scenario="straight", duration_s=2.0, out=path).run()
        size = sum(file.stat().st_size for file in path.iterdir())
        seen_s = record.duration_s - (record.latency_s or 0.0)
        with TwinRig("straight", overview=True) as rig:
            rig.clock.sleep_until(0.4)
            frame, eyes = rig.camera.latest(), MarkerEyes(rig.camera.calibration, rig.board)
            assert frame is not None
            assert rig.overview is not None
            seen = Seen(
                frame=frame,
                observation=eyes(frame),
                overview=rig.overview.latest(),
                truth=rig.truth.at_exposure(frame.seq),
            )
        folder = run_folder.RunFolder(Path(name) / "timed", {})
        (taken,) = median_times(lambda: folder.seen(seen), repeat=60)
        folder.close()
    return {"ms_per_frame": 1e3 * taken, "mb_per_min": size / 1e6 * 60 / seen_s}


def _unlogged(scenario: str) -> float:
    """Run the loop with pictures and markers but without a run folder."""
    factors: list[float] = []
    for _ in range(3):
        with TwinRig(scenario) as rig:
            rig.clock.sleep_until(0.0)
            camera = rig.camera.calibration
            eyes, law = MarkerEyes(camera, rig.board), registry.make("pi", camera)
            start = time.perf_counter()
            loop.run(rig, eyes, law, duration_s=RUN_S)
            factors.append(RUN_S / (time.perf_counter() - start))
    return median(factors)


def _run(eyes: str) -> float:
    factors: list[float] = []
    for _ in range(3):
        with tempfile.TemporaryDirectory() as name:
            out = Path(name) / "run"
            record = Experiment(scenario="straight", vision=eyes, duration_s=RUN_S, out=out).run()
            factors.append(record.duration_s / record.wall_s)
    return median(factors)
