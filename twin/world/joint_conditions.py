"""What the values of a scenario must fulfil together: nothing passes through anything else.

The base frame is the tip camera at rest. The section cannot stretch, so at all bends the endoscope
stays behind the origin, and what remains ahead of it there never meets it. The board does not turn;
a tilted one comes nearer to the tip as its motions carry its near side in front of it, and its
motions may carry it either way.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import accumulate
from math import radians
from typing import TYPE_CHECKING

from endolock.hw.api import ConfigError
from endolock.twin.world import mid_run
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.motion import BoardMotion, Circle, Random, Sine, Strokes, Triangle
from endolock.twin.world.scenario_sections import (
    LARGEST_BEND_DEG,
    Board,
    Occluder,
)

if TYPE_CHECKING:
    from endolock.twin.world.scenario import Scenario

WALL_BEHIND_M = 0.10
"""Wall behind the board at rest [m]. Assumed; it only fills the picture."""
PLATE_M = 0.002
"""Thickness of an occluder [m]. Assumed."""
TIP_RADIUS_M = 0.005
"""Radius of the tip [m]: that of gastroscopes."""
CLEARANCE_M = 0.002
"""Least distance of the board from the tip at rest [m]; the camera sees from 1 mm on. Assumed."""
WANDER = 4.0
"""Largest displacement of a random motion over its rms [1]: beyond it in 1 of 16,000 moments."""
MOST = 100
"""Most entries of a list, such as motions, pushes or occluders [1]. Assumed."""


def check(scenario: Scenario) -> None:
    """Check the values of a scenario together.

    Raises:
        ConfigError: some of them contradict each other.
    """
    for name in ("motion", "shaft", "push", "occluder", "change", "video_gap"):
        if (count := len(getattr(scenario, name))) > MOST:
            raise ConfigError(f"{name}: {count} entries, wanted up to {MOST}", "use fewer")
    if scenario.scored_from_s >= scenario.duration_s:
        raise ConfigError(
            f"scored_from_s {scenario.scored_from_s:g} is not before the end at "
            f"{scenario.duration_s:g} s",
            "use a smaller one or a longer duration_s",
        )
    _check_board(scenario.board, scenario.motion)
    _check_occluders(scenario.board, scenario.occluder)
    _check_bends(scenario)


def reach_m(motion: BoardMotion) -> float:
    """Return the largest displacement of a motion, in whatever direction [m]."""
    if isinstance(motion, Circle):
        return motion.radius_m
    if isinstance(motion, Random):
        return WANDER * motion.rms_position_m
    return motion.travel_m / 2 if isinstance(motion, Sine) else motion.travel_m


def rate_hz(motion: BoardMotion) -> float:
    """Return the highest frequency of a motion [Hz]: of a random one its cutoff, of a jump 0."""
    if isinstance(motion, Strokes | Triangle | Circle):
        return 1 / motion.period_s
    if isinstance(motion, Sine):
        return motion.frequency_hz * (1 + motion.drift_share)
    return motion.cutoff_hz if isinstance(motion, Random) else 0.0


def unseen(scenario: Scenario) -> list[str]:
    """Name what moves faster than frames can show: at half their rate, it may seem to rest."""
    most = scenario.camera.frame_rate_hz / 2
    rates = {f"motion.{n}": rate_hz(motion) for n, motion in enumerate(scenario.motion)}
    if scenario.board.depth_travel_m:
        rates["board.depth_period_s"] = 1 / scenario.board.depth_period_s
    return [
        f"{name} moves at {rate:.4g} Hz, faster than half the frame rate, {most:.4g} Hz; frames do "
        "not show its path"
        for name, rate in rates.items()
        if rate > most
    ]


def _check_board(board: Board, motions: Sequence[BoardMotion]) -> None:
    """Check that the board stays between tip and wall."""
    aside = sum(map(reach_m, motions)) + TIP_RADIUS_M
    nearest = board.distance_m - board.depth_travel_m / 2
    nearest -= min(aside * board.slope, board.relief_m)
    if nearest < CLEARANCE_M:
        raise ConfigError(
            f"board: travel and tilt bring its nearest point to {nearest:.4g} m ahead of the tip, "
            f"wanted {CLEARANCE_M:g} m or more",
            "use a larger distance_m, or less depth_travel_m, motion or tilt_deg",
        )
    back = board.depth_travel_m / 2 + board.relief_m
    if back >= WALL_BEHIND_M:
        raise ConfigError(
            f"board: travel and tilt bring its farthest point back by {back:.4g} m, into the wall "
            f"{WALL_BEHIND_M:g} m behind it",
            "use less depth_travel_m or tilt_deg",
        )


def _check_occluders(board: Board, occluders: Sequence[Occluder]) -> None:
    """Check that the board stays behind every plate."""
    nearest = board.distance_m - board.depth_travel_m / 2 - board.relief_m - PLATE_M
    for n, occluder in enumerate(occluders):
        if occluder.distance_m >= nearest:
            raise ConfigError(
                f"occluder.{n}.distance_m: should be less than board.distance_m "
                f"{board.distance_m:g} by the plate's thickness and the board's travel and tilt, "
                f"so less than {nearest:.4g} m, got {occluder.distance_m:g} m",
                "move the plate nearer or the board away",
            )


def check_shaft(scenario: Scenario, instrument: Instrument) -> None:
    """Check tension and friction of the wires at all bends of the shaft, and after all changes.

    Raises:
        ConfigError: a wire would break, or not move.
    """
    for rubbing in with_friction(scenario, instrument):
        for bend_deg in _bends_deg(scenario):
            rubbing.check_at(radians(bend_deg))


def with_friction(scenario: Scenario, instrument: Instrument) -> list[Instrument]:
    """Return an instrument, and what it becomes as each change gives it another friction.

    Raises:
        ConfigError: its friction would be out of range.
    """
    return [
        replace(
            instrument,
            conduit_friction=times * instrument.conduit_friction,
            section_friction=times * instrument.section_friction,
        )
        for times in mid_run.frictions(scenario.change)
    ]


def _check_bends(scenario: Scenario) -> None:
    """Check that the shaft is not bent further than by three loops at any time."""
    for bend_deg in _bends_deg(scenario):
        if abs(bend_deg) > LARGEST_BEND_DEG:
            raise ConfigError(
                f"shaft: the changes of its bend add up to {bend_deg:g} deg, wanted "
                f"{-LARGEST_BEND_DEG:g} to {LARGEST_BEND_DEG:g} deg",
                "use smaller ones, or another shaft_bend_deg",
            )


def _bends_deg(scenario: Scenario) -> Iterator[float]:
    """Return the bends of the shaft at the start and after each change [deg]."""
    bends = sorted((e for e in scenario.shaft if e.kind == "bend"), key=lambda e: e.start_s)
    return accumulate((e.by_deg for e in bends), initial=scenario.shaft_bend_deg)
