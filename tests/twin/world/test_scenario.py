"""Scenario files: their meaning, and the errors of wrong ones."""

import re
from pathlib import Path

import pytest

from endolock.hw.api import ConfigError
from endolock.twin.world import scenario
from endolock.twin.world.motion import Event
from endolock.twin.world.playback import Course
from endolock.twin.world.scenario_sections import PoseTrackerSettings

FOLDER = Path(scenario.__file__).parents[2] / "models/scenarios"
BEND = '[[shaft]]\nkind = "bend"\nstart_s = 0\nover_s = 1\nby_deg = 1\n'
TRIANGLE = '[[motion]]\nkind = "triangle"\ntravel_m = 0.1\nperiod_s = 1\n'
PLATE = """[[occluder]]
size_m = [0.1, 0.1]
position_m = [0, 0.2]
to_m = [0, 0]
start_s = 0
over_s = 1
"""
THESIS = ("straight", "circle")


def test_straight_and_circle_are_those_of_the_thesis() -> None:
    straight, circle = (Course(scenario.load(name), 0) for name in THESIS)
    assert straight.board(0.0) == (0.0, 0.0)
    assert straight.board(4.3) == pytest.approx((0.13, 0.0))
    assert circle.board(10.0) == pytest.approx((-0.06, 0.0))


def test_overrides_replace_the_file() -> None:
    loaded = scenario.load("straight", {"camera.latency_s": 0.2, "duration_s": 3.0})
    assert loaded.camera.latency_s == 0.2
    assert loaded.duration_s == 3.0
    assert loaded.board == scenario.load("straight").board


def test_a_tracker_is_added_by_a_file_or_an_override(tmp_path: Path) -> None:
    assert scenario.load("straight").tracker is None
    faster = scenario.load("straight", {"tracker.rate_hz": 50})
    assert faster.tracker == PoseTrackerSettings(rate_hz=50.0)
    file = tmp_path / "mine.toml"
    file.write_text("[tracker]\n")
    assert scenario.load(file).tracker == PoseTrackerSettings()


def test_a_tracker_is_added_to_a_loaded_scenario() -> None:
    loaded = scenario.load("straight")
    assert scenario.load(loaded, {"tracker.rate_hz": 50}).tracker == PoseTrackerSettings(rate_hz=50)


@pytest.mark.parametrize("name", scenario.names())
def test_a_loaded_scenario_is_overridden_like_its_file(name: str) -> None:
    changes = {"duration_s": 3.0}
    assert scenario.load(scenario.load(name), changes) == scenario.load(name, changes)


def test_a_value_is_not_a_section_of_a_loaded_scenario() -> None:
    with pytest.raises(ConfigError) as caught:
        scenario.load(scenario.load("straight"), {"duration_s.x": 1})
    assert str(caught.value) == (
        "scenario straight: duration_s is not a section, so there is no duration_s.x; "
        "give duration_s itself"
    )


def test_sources_name_list_items_by_number() -> None:
    found = scenario.sources("push", {"tracker.rate_hz": 50.0})
    assert found["push.0.force_n"] == (0.5, "file")
    assert found["push.0.direction_deg"] == (0.0, "file")
    assert found["tracker.rate_hz"] == (50.0, "option")
    assert found["tracker.latency_s"] == (0.01, "default")
    assert found["gravity"] == (False, "default")
    assert scenario.sources("rest", {})["tracker"] == (None, "default")


def test_everything_can_be_combined(tmp_path: Path) -> None:
    parts = [(FOLDER / f"{name}.toml").read_text() for name in ("push", "roll", "occlusion")]
    lists = [text[text.index("[[") :] for text in parts]
    file = tmp_path / "all.toml"
    file.write_text("gravity = true\n" + "\n".join(lists))
    loaded = scenario.load(file)
    assert loaded.gravity
    counts = len(loaded.motion), len(loaded.shaft), len(loaded.push), len(loaded.occluder)
    assert counts == (3, 1, 1, 2)


@pytest.mark.parametrize("name", scenario.names())
def test_every_scenario_has_a_summary_and_its_events_start_in_time(name: str) -> None:
    loaded = scenario.load(name)
    assert loaded.summary
    assert len(loaded.summary) <= 100  # one line
    jumps = [motion for motion in loaded.motion if isinstance(motion, Event)]
    events = (*loaded.shaft, *loaded.push, *loaded.occluder, *loaded.change, *loaded.video_gap)
    for event in (*jumps, *events):
        assert 0 < event.start_s < event.start_s + event.over_s <= loaded.duration_s


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("latencys = 1", "unknown key latencys; did you mean camera.latency_s?"),
        ("colour = 1", "unknown key colour; known are summary, duration_s, scored_from_s"),
        ("[camera]\nlatency = 0.1", "unknown key camera.latency; did you mean camera.latency_s?"),
        ("[camera]\nlatency_s = -0.1", "camera.latency_s: got -0.1 s, wanted 0 to 5 s"),
        ("duration_s = 0", "duration_s: got 0 s, wanted 0.02 to 86400 s; give seconds"),
        ("duration_s = inf", "duration_s: should be a finite number"),
        ('duration_s = "long"', "duration_s: should be a valid number"),
        (
            '[[motion]]\nkind = "square"',
            "motion.0: got kind 'square', wanted 'strokes', 'triangle'",
        ),
        (
            '[[motion]]\nkind = "circle"\nradius_m = 0.1',
            "motion.0.circle.period_s: missing; give it",
        ),
        (
            '[[motion]]\nkind = "circle"\nradius_m = 0.1\nperiod_s = 1\nrim = 2',
            "unknown key motion.0.circle.rim; known are kind, radius_m, period_s",
        ),
        (
            f"{TRIANGLE}turn_s = 2",
            "motion.0.triangle: turn_s 2 is more than half of period_s 1; use less",
        ),
        ("duration_s = ", "is not TOML"),
        ("rate = 50", "unknown key rate; did you mean tracker.rate_hz?"),
        ("drop_fraction = 0", "did you mean camera.drop_fraction?"),
        (
            "[tracker]\nlatency = 0.1",
            "unknown key tracker.latency; did you mean tracker.latency_s?",
        ),
        ("[tracker]\nrate_hz = 0", "tracker.rate_hz: got 0 Hz, wanted 0.1 to 1000 Hz"),
        ("[[shafts]]", "unknown key shafts; did you mean shaft?"),
        ("[shaft]\nby_deg = 1", "shaft: there may be several; write [[shaft]]"),
        ("[[tracker]]", "tracker: there is only one; write [tracker]"),
        ("[[motion]]\ntravel_m = 1", "motion.0: 'kind' is missing"),
        ("[[push]]\nforce = 1", "unknown key push.0.force; did you mean push.0.force_n?"),
        (f"{BEND}angle = 3", "unknown key shaft.0.angle; known are start_s, over_s, kind, by_deg"),
        (f"{BEND}by_degs = 3", "unknown key shaft.0.by_degs; did you mean shaft.0.by_deg?"),
        (
            '[[shaft]]\nkind = "twist"\nstart_s = 0\nover_s = 1\nby_deg = 1',
            "shaft.0.kind: should be 'bend' or 'roll', got 'twist'",
        ),
        ("[[push]]\nstart_s = 1\nover_s = 0\nforce_n = 1", "push.0.over_s: got 0 s, wanted 0.001"),
        ("[[push]]\nstart_s = 1\nover_s = 1", "push.0.force_n: missing; give it"),
        (
            f"{PLATE}distance_m = 0.12",
            "occluder.0.distance_m: should be less than board.distance_m",
        ),
        (f"{PLATE}distance_m = 0.06\nsize = 1", "did you mean occluder.0.size_m?"),
    ],
)
def test_errors_in_files_are_explained_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=re.escape(message)) as caught:
        scenario.load(file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("strait", "scenario 'strait' is unknown; use breathing, circle, close,"),
        ("strait", "stop_and_go, straight, triangle or a .toml file; did you mean straight?"),
        ("nowhere.toml", "cannot read scenario nowhere.toml: No such file or directory"),
        ("", "scenario '' is unknown"),
    ],
)
def test_missing_scenarios_are_explained(source: str, message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)):
        scenario.load(source)
