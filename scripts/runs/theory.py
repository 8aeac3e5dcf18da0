"""Theoretical bounds of a run: stability margins of a linear controller, error floor of any."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from endolock.control.transmission.kinematics import SectionGeometry
from endolock.control.transmission.linear_process import HOLD_S, LAG_S, Process, image_gain
from endolock.hw.api import ConfigError
from endolock.twin.camera import optics
from endolock.twin.world.motion import Random
from endolock.twin.world.scenario import Scenario

PIXEL_NOISE = 0.1
"""Standard deviation of each coordinate of the target assumed in the floor [px]: that of the
markers."""


def of(scenario: Scenario, settings: Any) -> dict[str, Any]:
    """Return margins {gain, phase_deg, dead_s} and floor_px of a run; None where undefined.

    Args:
        scenario: gives distance and latency.
        settings: settings of the controller.
    """
    built_in = not isinstance(settings, dict)  # a controller from a file has no known linear part
    margins = _margins(settings, process_of(scenario)) if built_in else None
    return {"margins": margins, "floor_px": floor_px(scenario)}


def process_of(scenario: Scenario) -> Process:
    """Return the linear model of a task, from its distance and latency."""
    gain = image_gain(SectionGeometry(), scenario.board.distance_m)
    return Process(gain=gain, dead_s=scenario.camera.latency_s + HOLD_S)


def check_stable(name: str, settings: Any, scenario: Scenario) -> None:
    """Check that the gains of a controller make the linear loop stable.

    Raises:
        ConfigError: the gain margin is below 1.
    """
    from endolock.control import analysis  # python-control takes seconds to load

    process = process_of(scenario)
    if (response := analysis.response(settings, process)) is None:
        return
    margin = analysis.margins(response, process).gain
    if margin < 1:
        raise ConfigError(
            f"{name} is unstable with these values: gain margin {margin:.2f}, above 1 needed, with "
            f"{process.gain:.2f} rad of error per rad of handle and {process.dead_s:.2f} s of dead "
            "time",
            "use lower gains, or --force",
        )


@lru_cache(maxsize=256)
def _margins(settings: Any, process: Process) -> dict[str, float] | None:
    from endolock.control import analysis  # python-control takes seconds to load

    response = analysis.response(settings, process)
    return None if response is None else analysis.margins(response, process)._asdict()


def floor_px(scenario: Scenario) -> float | None:
    """Return the smallest rms error possible where the only motion is random [px], else None.

    The prediction horizon is the video latency, plus the lag and the hold time of the handles.
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
