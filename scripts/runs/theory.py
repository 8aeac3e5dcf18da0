"""What theory says of a run before it is made: margins of a linear law, floor of any law."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from endolock.control.transmission.linear_process import HOLD_S, LAG_S, Process
from endolock.scripts.commands import run
from endolock.twin.camera import optics
from endolock.twin.world.motion import Random
from endolock.twin.world.scenario import Scenario

PIXEL_NOISE = 0.1
"""Noise of each coordinate of the target that the floor grants [px]: that of markers."""


def of(request: run.Request) -> dict[str, Any]:
    """Return margins {gain, phase_deg, dead_s} and floor_px of a run; None where there is none."""
    task = run.resolve(request)
    scenario = task.scenario
    return {
        "margins": _margins(task.settings, run.process_of(scenario)),
        "floor_px": floor_px(scenario),
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
