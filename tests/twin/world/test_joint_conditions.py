"""What the values of a scenario must fulfil together."""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from endolock.hw import boards, rotation
from endolock.hw.api import ConfigError
from endolock.scripts.runs import overrides
from endolock.twin.world import joint_conditions, scenario
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.playback import Course
from endolock.twin.world.scenario import Scenario

REST = scenario.load("rest")
STROKE = {"kind": "strokes", "travel_m": 0.01, "period_s": 8.6}
PLATE = {
    "size_m": [0.1, 0.1],
    "distance_m": 0.06,
    "position_m": [0, 0.2],
    "to_m": [0, 0],
    "start_s": 0,
    "over_s": 1,
}
BEND = {"kind": "bend", "start_s": 1, "over_s": 1, "by_deg": 500}
SINE = {"kind": "sine", "travel_m": 0.01}
RANDOM = {"kind": "random", "cutoff_hz": 0.3}
MANY = 101 * [STROKE]
GAP = {"start_s": 1, "over_s": 1}


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        (
            {"board.distance_m": 0.05, "board.depth_travel_m": 0.9},
            "its nearest point to -0.4 m",
        ),
        ({"board.distance_m": 0.015, "board.tilt_deg": 80}, "wanted 0.002 m or more"),
        (
            {"board.distance_m": 0.015, "board.tilt_deg": 45, "motion": [STROKE, STROKE]},
            "use a larger distance_m, or less depth_travel_m, motion or tilt_deg",
        ),
        (
            {"board.distance_m": 0.7, "board.depth_travel_m": 0.2},
            "its farthest point back by 0.1 m, into the wall 0.1 m behind it",
        ),
        ({"occluder": [PLATE], "board.depth_travel_m": 0.12}, "occluder.0.distance_m: should be"),
        ({"occluder": [{**PLATE, "distance_m": 0.119}]}, "so less than 0.118 m, got 0.119 m"),
        (
            {"occluder": [PLATE], "board.tilt_deg": 70, "board.tilt_axis_deg": 45},
            "occluder.0.distance_m: should be less than",
        ),
        ({"shaft": [BEND, BEND]}, "its bend add up to 1180 deg, wanted -1080 to 1080 deg"),
        ({"scored_from_s": 25}, "scored_from_s 25 is not before the end at 25 s"),
        ({"video_gap": 101 * [GAP]}, "video_gap: 101 entries, wanted up to 100"),
        ({"change": [GAP]}, "change.0: changes nothing; give one of latency_s, nominal_lat"),
        ({"change": [{**GAP, "friction_times": -1}]}, "friction_times: got -1, wanted 0 to 10"),
        ({"change": [{**GAP, "latency_s": 6}]}, "change.0.latency_s: got 6 s, wanted 0 to 5 s"),
        ({"change": [{**GAP, "jitter": 0.1}]}, "did you mean change.0.jitter_s?"),
        ({"motion": MANY}, "motion: 101 entries, wanted up to 100"),
        (
            {"motion": [{**RANDOM, "speed_rms_m_s": 2, "cutoff_hz": 0.001}]},
            "move the board by 318.31 m rms, wanted 0 to 1 m",
        ),
        ({"camera.width": 4096, "camera.height": 4096}, "has 16777216 pixels, wanted up to"),
        (
            {"camera.projection": "equidistant", "camera.diagonal_deg": 150, "camera.width": 4096},
            "needs a picture of 10510 px, wanted up to 8192 px",
        ),
        ({"camera.exposure_s": 0.05}, "exposure_s 0.05 is longer than a frame of 0.04 s; use less"),
        ({"summary": "a\nb"}, "summary: got 'a.*b', wanted up to 200 printable characters"),
    ],
)
def test_values_that_cannot_be_together_are_refused(changes: dict[str, Any], why: str) -> None:
    with pytest.raises(ConfigError, match=why) as caught:
        scenario.load(REST, changes)
    assert str(caught.value).isprintable()
    assert caught.value.next_step


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"motion": [{**STROKE, "period_s": 0.05}]}, "motion.0 moves at 20 Hz"),
        ({"motion": [STROKE, {**RANDOM, "cutoff_hz": 13}]}, "motion.1 moves at 13 Hz"),
        (
            {"motion": [{**SINE, "frequency_hz": 10, "drift_share": 0.3}]},
            "motion.0 moves at 13 Hz",
        ),
        ({"motion": [RANDOM], "camera.frame_rate_hz": 0.5}, "half the frame rate, 0.25 Hz"),
        (
            {"board.depth_travel_m": 0.01, "board.depth_period_s": 0.05},
            "board.depth_period_s moves",
        ),
    ],
)
def test_what_frames_cannot_show_is_said(changes: dict[str, Any], said: str) -> None:
    """It is no impossible scenario: a slow camera may look at anything."""
    (note,) = joint_conditions.unseen(scenario.load(REST, changes))
    assert said in note
    assert not joint_conditions.unseen(REST)


def test_a_changed_copy_is_checked_when_it_is_used() -> None:
    """A copy by `model_copy` is not checked by pydantic."""
    near = REST.model_copy(update={"board": REST.board.model_copy(update={"distance_m": True})})
    with pytest.raises(ConfigError, match=r"board\.distance_m: should be a valid number, got true"):
        scenario.load(near)
    short = REST.model_copy(update={"duration_s": 1.0})
    assert scenario.load(short) is short


@pytest.mark.parametrize("name", ["", "a/b", "../a", "a\nb", "\x1b[2J", "x" * 201])
def test_a_name_is_that_of_a_folder(name: str) -> None:
    with pytest.raises(ValueError, match="name"):
        Scenario(name=name)


@pytest.mark.parametrize("name", scenario.names())
def test_what_comes_with_the_package_can_be_combined(name: str) -> None:
    near = scenario.load(name).board.distance_m < 0.1
    options = {"board.distance_m": 0.12} if near else {}  # disturbances are for 12 cm
    for change in overrides.names():
        assert overrides.apply(name, "two_region", (change,), options).scenario, change


@given(
    distance_m=st.floats(0.005, 0.2),
    travel_m=st.floats(0.0, 0.15),
    tilt_deg=st.floats(-85.0, 85.0),
    axis_deg=st.floats(0.0, 360.0),
    stroke_m=st.floats(0.0, 0.3),
    direction_deg=st.floats(0.0, 360.0),
)
def test_no_part_of_a_board_that_is_taken_meets_the_tip(
    distance_m: float,
    travel_m: float,
    tilt_deg: float,
    axis_deg: float,
    stroke_m: float,
    direction_deg: float,
) -> None:
    """Points of the board that pass in front of the tip are ahead of it, at all times."""
    stroke = {**STROKE, "travel_m": stroke_m, "direction_deg": direction_deg}
    board = {"distance_m": distance_m, "depth_travel_m": travel_m, "tilt_deg": tilt_deg}
    try:
        made = scenario.load(
            REST, {"board": {**board, "tilt_axis_deg": axis_deg}, "motion": [stroke]}
        )
    except ConfigError:
        assume(False)
    side = np.linspace(-boards.SIZE_M / 2, boards.SIZE_M / 2, 41)
    flat = np.array([(x, y, 0.0) for x in side for y in side])
    points = flat @ rotation.to_matrix(made.board.quaternion).T
    course = Course(made, 0)
    for t in np.linspace(0.0, 8.6, 21).tolist():
        right, down = course.board(t)
        moved = points + (right, down, distance_m + course.depth(t))
        ahead = moved[np.hypot(moved[:, 0], moved[:, 1]) < joint_conditions.TIP_RADIUS_M, 2]
        assert ahead.size == 0 or ahead.min() > 0
        assert moved[:, 2].max() < distance_m + joint_conditions.WALL_BEHIND_M


def test_an_instrument_must_fit_the_shaft_of_a_scenario() -> None:
    lossy = Instrument(slack_loss_m_per_rad=0.02, wire_stiffness=5e4, slack_m=0.0)
    joint_conditions.check_shaft(scenario.load("rest", {"shaft_bend_deg": 90.0}), lossy)
    with pytest.raises(ConfigError, match="pretension of 3142 N with the shaft at 180 deg, wanted"):
        joint_conditions.check_shaft(REST, lossy)
    late = scenario.load("rest", {"shaft_bend_deg": 0.0, "shaft": [{**BEND, "by_deg": -180}]})
    with pytest.raises(ConfigError, match="with the shaft at -180 deg"):
        joint_conditions.check_shaft(late, lossy)
    assert lossy.slack_at(-pi) == lossy.slack_at(pi)
