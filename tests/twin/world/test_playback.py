"""The course of a run: positions and forces at any time."""

from math import pi, radians, sin
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.twin.model import scene
from endolock.twin.world import scenario
from endolock.twin.world.playback import Course
from endolock.twin.world.scenario import Scenario

RANDOM = {"kind": "random"}
JUMP = {"kind": "jump", "travel_m": 0.02, "start_s": 1.0, "over_s": 1.0}
PUSH = {"start_s": 10.0, "over_s": 1.0, "force_n": 0.4, "direction_deg": 90.0}
PLATE = {
    "size_m": [0.02, 0.03],
    "distance_m": 0.06,
    "position_m": [0.1, 0.2],
    "to_m": [-0.1, 0.0],
    "start_s": 2.0,
    "over_s": 4.0,
}


def _course(seed: int = 0, **values: Any) -> Course:
    return Course(Scenario.model_validate({"name": "mine", **values}), seed)


def _roll(start_s: float, by_deg: float) -> dict[str, Any]:
    return {"kind": "roll", "start_s": start_s, "over_s": 1.0, "by_deg": by_deg}


def test_nothing_happens_in_an_empty_scenario() -> None:
    course = _course()
    assert course.board(3.0) == (0.0, 0.0)
    assert course.shaft_bend_rad(3.0) == pi
    assert course.shaft_roll_rad(3.0) == 0.0
    assert course.tip_force(3.0) == (0.0, 0.0, 0.0)
    assert course.occluders(3.0) == ()
    assert not course.turns
    assert not course.pushes


def test_motions_add_up() -> None:
    stroke = {"kind": "strokes", "travel_m": 0.1, "period_s": 2.0}
    assert _course(motion=[stroke, stroke, JUMP]).board(1.5) == pytest.approx((0.11, 0.0))


def test_changes_of_the_shaft_add_up_and_are_permanent() -> None:
    bend = {"kind": "bend", "start_s": 20.0, "over_s": 20.0, "by_deg": 360.0}
    course = _course(shaft_bend_deg=90.0, shaft=[bend, _roll(5.0, 10.0), _roll(5.5, -30.0)])
    bends = [course.shaft_bend_rad(t) for t in (0.0, 20.0, 25.0, 40.0, 1e5)]
    assert bends == pytest.approx([radians(d) for d in (90, 90, 180, 450, 450)])
    rolls = [course.shaft_roll_rad(t) for t in (5.0, 5.5, 6.0, 6.5, 1e5)]
    assert rolls == pytest.approx([radians(d) for d in (0, 5, -5, -20, -20)])
    assert course.turns


@given(t=st.floats(0.0, 30.0))
def test_a_push_is_half_a_sine(t: float) -> None:
    course = _course(push=[PUSH])
    force = 0.4 * sin(pi * (t - 10.0)) if 10.0 < t < 11.0 else 0.0
    # a force upwards has a negative y; the sine of large arguments is rounded
    assert course.tip_force(t) == pytest.approx((0.0, -force, 0.0), abs=1e-12)
    assert course.pushes


def test_pushes_end_and_add_up() -> None:
    course = _course(push=[PUSH, {**PUSH, "direction_deg": 0.0}])
    assert course.tip_force(10.0) == course.tip_force(11.0) == (0.0, 0.0, 0.0)
    assert course.tip_force(10.5) == pytest.approx((0.4, -0.4, 0.0))


def test_an_occluder_waits_moves_and_stops() -> None:
    course = _course(occluder=[PLATE, {**PLATE, "start_s": 9.0}])
    places = [course.occluders(t)[0] for t in (0.0, 2.0, 3.0, 6.0, 1e5)]
    assert np.array(places) == pytest.approx(
        np.array([(0.1, 0.2, 0.06)] * 2 + [(0.05, 0.15, 0.06)] + [(-0.1, 0.0, 0.06)] * 2)
    )
    assert course.occluders(6.0)[1] == pytest.approx((0.1, 0.2, 0.06))


def test_random_motions_are_independent_of_the_rest_of_the_scenario() -> None:
    times = (0.0, 1.7, 30.0, 4.2)
    alone = [_course(5, motion=[RANDOM]).board(t) for t in times]
    rest: dict[str, Any] = {"push": [PUSH], "occluder": [PLATE], "camera": {"jitter_s": 0.02}}
    assert [_course(5, motion=[RANDOM], **rest).board(t) for t in times] == alone
    late = {**JUMP, "start_s": 100.0}
    assert [_course(5, motion=[late, RANDOM]).board(t) for t in times] == alone
    assert [_course(6, motion=[RANDOM]).board(t) for t in times] != alone


def test_several_random_motions_differ_and_the_first_is_unchanged() -> None:
    one = np.array(_course(motion=[RANDOM]).board(3.0))
    two = np.array(_course(motion=[RANDOM, RANDOM]).board(3.0))
    still = {**RANDOM, "speed_rms_m_s": 0.0}
    assert _course(motion=[RANDOM, still]).board(3.0) == pytest.approx(one)
    assert np.abs(two - 2 * one).min() > 1e-4  # the second one is different


@pytest.mark.parametrize("name", scenario.names())
def test_two_courses_of_one_scenario_are_the_same(name: str) -> None:
    loaded = scenario.load(name)
    one, other = Course(loaded, 1), Course(loaded, 1)
    times = np.linspace(0.0, loaded.duration_s, 50).tolist()
    backwards = [_everything(other, t) for t in reversed(times)]
    assert [_everything(one, t) for t in times] == backwards[::-1]


def _everything(course: Course, t: float) -> tuple[Any, ...]:
    asked = (course.board, course.shaft_bend_rad, course.shaft_roll_rad)
    return *(ask(t) for ask in asked), course.tip_force(t), course.occluders(t)


def test_occluders_are_bodies_that_hide_and_touch_nothing() -> None:
    model = scene.build(
        occluders=[scene.Plate(size, "plain") for size in ((0.02, 0.04), (0.1, 0.2))]
    ).compile()
    plain = scene.build().compile()
    assert model.nq == plain.nq
    for n, half in ((1, (0.01, 0.02)), (2, (0.05, 0.1))):
        geom = model.geom(f"occluder_{n}")
        assert geom.size[:2] == pytest.approx(half)
        assert not geom.contype
        assert not geom.conaffinity
        assert geom.group == model.geom("board").group
        assert model.body(f"occluder_{n}").mocapid[0] >= 0


def test_an_occluder_is_seen_at_its_position() -> None:
    """A plate of 40 x 20 mm, 60 mm ahead, covers f w / d by f h / d pixels of the picture."""
    model = scene.build(occluders=[scene.Plate((0.04, 0.02), "plain")]).compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    place = scene.WORLD_FROM_BASE @ (0.01, 0.005, 0.06)
    data.mocap_pos[model.body("occluder_1").mocapid[0]] = [0.09, 0, 0] + place
    mujoco.mj_forward(model, data)
    renderer = mujoco.Renderer(model, 480, 640)
    renderer.enable_segmentation_rendering()
    renderer.update_scene(data, "tip")
    rows, columns = np.nonzero(renderer.render()[..., 0] == model.geom("occluder_1").id)
    renderer.close()
    f = 240 / np.tan(radians(85 / 2))
    centre = np.array([columns.mean(), rows.mean()]) - (319.5, 239.5)
    assert centre == pytest.approx((f / 6, f / 12), abs=0.5)  # edges are rounded to whole pixels
    width, height = np.ptp(columns) + 1, np.ptp(rows) + 1
    assert (width, height) == pytest.approx((f * 4 / 6, f * 2 / 6), abs=1)  # likewise
