"""What is known of a task before a run: margins, floors, and what a constant handle would score."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from endolock.control.process import HOLD_S, LAG_S, Process
from endolock.scripts import run
from endolock.scripts.target_path import hindsight
from endolock.twin import optics
from endolock.twin.motion import Random
from endolock.twin.scenario import Scenario

PIXEL_NOISE = 0.1
"""Noise of each coordinate of the target that the floor grants [px]: that of markers."""


def of(request: run.Request) -> dict[str, Any]:
    """Return what is known of a run's task; None where there is none, as of a bench's path.

    Returns:
        margins {gain, phase_deg, dead_s} of the law, floor_px, constant_px {as error_px} of the
        best constant handle in hindsight, needed_tip_deg of both axes.
    """
    task = run.resolve(request)
    scenario = task.scenario
    path = None if task.bench else hindsight(scenario, task.instrument, request.seed)
    return {
        "margins": _margins(task.settings, run.process_of(scenario)),
        "floor_px": floor_px(scenario),
        "constant_px": path and path.constant_px,
        "needed_tip_deg": path and list(path.needed_tip_deg),
    }


@lru_cache(maxsize=256)
def _margins(settings: Any, process: Process) -> dict[str, float] | None:
    from endolock.control import analysis  # python-control takes seconds to load

    response = analysis.response(settings, process)
    return None if response is None else analysis.margins(response, process)._asdict()


def floor_px(scenario: Scenario) -> float | None:
    """Least rms error for a board that moves at random and nothing else [px].

    The horizon is the latency and what a command takes to move the tip.
    """
    random = [motion for motion in scenario.motion if isinstance(motion, Random)]
    if len(random) != 1 or len(scenario.motion) > 1:
        return None
    from endolock.control import analysis

    video, (motion,) = scenario.camera, random
    pixels_per_m = optics.calibration(video).focal_px / scenario.board.distance_m
    horizon_s = video.latency_s + LAG_S + HOLD_S
    one_axis = analysis.wiener_floor(
        motion.speed_rms_m_s * pixels_per_m,
        motion.cutoff_hz,
        horizon_s,
        PIXEL_NOISE,
        1 / video.frame_rate_hz,
    )
    return float(2**0.5 * one_axis)
