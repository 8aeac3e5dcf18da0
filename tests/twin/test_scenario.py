"""Scenario files: what they mean, and what is said of wrong ones."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.hw.api import ConfigError
from endolock.twin import scenario


@given(t=st.floats(0.0, 100.0), direction_deg=st.floats(-180.0, 180.0))
def test_strokes_stay_on_one_side_of_a_line(t: float, direction_deg: float) -> None:
    stroke = scenario.Strokes(
        kind="strokes", direction_deg=direction_deg, travel_m=0.13, period_s=8.6
    )
    right, down = stroke.offset(t)
    half_right, half_down = stroke.offset(4.3)
    along = (right * half_right + down * half_down) / 0.13
    assert -1e-12 <= along <= 0.13 + 1e-12  # rounding
    assert right * half_down == pytest.approx(down * half_right, abs=1e-12)  # rounding


def test_strokes_to_the_right_and_up() -> None:
    straight = scenario.load("straight")
    assert straight.offset(0.0) == (0.0, 0.0)
    assert straight.offset(4.3) == pytest.approx((0.13, 0.0))
    up = scenario.Strokes(kind="strokes", direction_deg=90.0, travel_m=0.1, period_s=2.0)
    assert up.offset(1.0) == pytest.approx((0.0, -0.1))


@given(t=st.floats(0.0, 100.0))
def test_the_circle_is_a_circle(t: float) -> None:
    right, down = scenario.load("circle").offset(t)
    assert right**2 + down**2 == pytest.approx(0.06**2)


def test_the_circle_is_clockwise_and_starts_at_the_right() -> None:
    circle = scenario.load("circle")
    assert circle.offset(0.0) == pytest.approx((0.06, 0.0))
    assert circle.offset(5.0) == pytest.approx((0.0, 0.06))


def test_motions_add_up(tmp_path: Path) -> None:
    stroke = '[[motion]]\nkind = "strokes"\ntravel_m = 0.1\nperiod_s = 2.0\n'
    file = tmp_path / "both.toml"
    file.write_text(stroke + stroke)
    assert scenario.load(file).offset(1.0) == pytest.approx((0.2, 0.0))
    assert scenario.load(file).name == "both"


def test_overrides_replace_the_file() -> None:
    loaded = scenario.load("straight", {"camera.latency_s": 0.2, "duration_s": 3.0})
    assert loaded.camera.latency_s == 0.2
    assert loaded.duration_s == 3.0
    assert loaded.board == scenario.load("straight").board


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("latencys = 1", "unknown key latencys; did you mean camera.latency_s?"),
        ("colour = 1", "unknown key colour; known are summary, duration_s, scored_from_s"),
        ("[camera]\nlatency = 0.1", "unknown key camera.latency; did you mean camera.latency_s?"),
        ("[camera]\nlatency_s = -0.1", "camera.latency_s: should be greater than or equal to 0"),
        ("duration_s = 0", "duration_s: should be greater than 0, got 0"),
        ("duration_s = inf", "duration_s: should be a finite number"),
        ('duration_s = "long"', "duration_s: should be a valid number"),
        ('[[motion]]\nkind = "square"', "motion.0: Input tag 'square' found using 'kind'"),
        ('[[motion]]\nkind = "circle"\nradius_m = 0.1', "motion.0.circle.period_s: Field required"),
        (
            '[[motion]]\nkind = "circle"\nradius_m = 0.1\nperiod_s = 1\nrim = 2',
            "unknown key motion.0.circle.rim; known are kind, radius_m, period_s",
        ),
        ("duration_s = ", "is not TOML"),
    ],
)
def test_wrong_files_are_explained_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=re.escape(message)) as caught:
        scenario.load(file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("strait", "scenario 'strait' is unknown; use circle, rest, straight or a .toml file; did"),
        ("nowhere.toml", "cannot read scenario nowhere.toml: No such file or directory"),
        ("", "scenario '' is unknown"),
    ],
)
def test_missing_scenarios_are_explained(source: str, message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)):
        scenario.load(source)
