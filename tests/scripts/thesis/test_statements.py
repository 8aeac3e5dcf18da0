"""The statements of the excerpt and its five figures, from runs without pictures."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from endolock.control.laws.hysteresis_compensation import CompensationSettings
from endolock.control.laws.pi import PISettings
from endolock.scripts.runs import hysteresis_widths
from endolock.scripts.runs.batch import FOLLOWED
from endolock.scripts.runs.hysteresis_measurement import HysteresisMeasurement
from endolock.scripts.studies import controller_calibration
from endolock.scripts.thesis import chapter_figures, chapter_runs, statements


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> chapter_runs.Runs:
    series, runs = chapter_runs.perform(tmp_path_factory.mktemp("runs") / "all", "truth")
    assert series.stopped is None
    return runs


def test_fourteen_statements_are_answered_for_both_columns(runs: chapter_runs.Runs) -> None:
    rows = statements.ask(runs)
    pairs = [(row["id"], row["column"]) for row in rows]
    assert pairs == [(f"T{n}", column) for n in range(1, 15) for column in ("a", "b")]
    keys = {"id", "column", "statement", "expected", "got", "ok", "basis"}
    assert all(set(row) == keys for row in rows)
    found = [(row["id"], row["column"]) for row in rows if row["basis"] == "calibrated"]
    assert found == [("T1", "a"), ("T1", "b"), ("T2", "a"), ("T2", "b"), ("T4", "b")]
    assert {row["id"] for row in rows if row["basis"] == "provoked"} == {"T7"}
    assert all(row["got"] and row["statement"] for row in rows)


def test_what_the_excerpt_does_not_state_is_not_judged(runs: chapter_runs.Runs) -> None:
    rows = statements.ask(runs)
    silent = {(row["id"], row["column"]) for row in rows if row["ok"] is None}
    assert silent == {(name, "a") for name in ("T8", "T9", "T10", "T11", "T12", "T14")}
    assert all((row["ok"] is None) == (row["expected"] is None) for row in rows)


def test_three_of_four_calibrated_bounds_hold_and_the_rate(runs: chapter_runs.Runs) -> None:
    """T1 holds for no pair of gains in both columns: docs/control.md explains the choice."""
    rows = {(row["id"], row["column"]): row["ok"] for row in statements.ask(runs)}
    assert rows["T1", "a"]
    assert not rows["T1", "b"]
    assert rows["T2", "a"]
    assert rows["T2", "b"]
    assert rows["T4", "b"]


@pytest.mark.parametrize("column", ["a", "b"])
@pytest.mark.parametrize("name", ["straight-pi", "straight-pi_hc", "straight-ik", "free"])
def test_the_tip_follows_in_the_runs_of_the_statements(
    column: str, name: str, runs: chapter_runs.Runs
) -> None:
    moved = runs[column][name].tip_deg(2 * chapter_runs.STROKE_S)
    low, high = (share * statements.needed_deg() for share in FOLLOWED)
    assert low <= moved <= high


def test_the_tip_rests_if_the_handles_are_held(runs: chapter_runs.Runs) -> None:
    for column, traces in runs.items():
        assert traces["straight-still"].tip_deg() < 0.01, column


def test_the_endoscope_lies_straight_with_the_loop_width_of_the_excerpt() -> None:
    task = chapter_runs.experiment("b", "straight", "pi").resolve()
    assert task.scenario.shaft_bend_deg == 0.0
    measurement = HysteresisMeasurement(
        instrument=chapter_runs.INSTRUMENT, shaft_deg=0.0, noise_deg=0.0
    )
    record = hysteresis_widths.figures(measurement.strokes(whole=False).strokes)
    assert record["width"]["30"] == pytest.approx(0.2, abs=0.01)  # 0.2 has one digit
    assert record["deadband_rad"] == 0.0


@pytest.mark.slow
def test_the_gains_in_use_are_those_of_the_calibration() -> None:
    best = controller_calibration.pairs()[0]
    assert (best.kp, best.ki) == (PISettings().kp, PISettings().ki)
    slowest = min(rate for rate, (_, ok) in controller_calibration.rates().items() if ok)
    assert f"law.rate_per_s={slowest}" == chapter_runs.IK_RATE
    rests = [
        speed
        for speed, moved in controller_calibration.switch_offs().items()
        if moved < controller_calibration.RESTS_DEG
    ]
    assert CompensationSettings().switch_off_rad_s == min(rests)


def test_mismatches_come_first(runs: chapter_runs.Runs) -> None:
    text = chapter_runs.markdown(statements.ask(runs))
    holds = [line.split("|")[-3].strip() for line in text.splitlines()[2:]]
    assert holds == sorted(holds, key=["**no**", "yes", "not stated"].index)


def test_the_figures_of_chapter_6_are_drawn_with_their_data(
    runs: chapter_runs.Runs, tmp_path: Path
) -> None:
    pictures = chapter_figures.draw(runs, tmp_path)
    assert sorted(p.name for p in pictures) == [f"figure_6.{n}.png" for n in range(4, 9)]
    for picture in pictures:
        image = cv2.imread(str(picture))
        assert image is not None
        assert np.std(image) > 1  # not empty
        rows = picture.with_suffix(".csv").read_text().splitlines()
        assert len(rows) > 25 * 19  # 25 frames per second, without the delay of the first


def test_compensation_is_half_the_width_of_the_excerpt(runs: chapter_runs.Runs) -> None:
    a, b = (runs[column]["circle-pi_hc"].compensation for column in ("a", "b"))
    assert abs(a).max() == pytest.approx(18.0)  # half of 0.2 of 180 deg
    assert abs(b).max() == pytest.approx(18.0)
