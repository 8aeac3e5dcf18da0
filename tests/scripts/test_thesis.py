"""The thirteen statements and the five figures, from runs without pictures."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from endolock.scripts import thesis, thesis_figures, thesis_statements


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> thesis.Runs:
    records, runs = thesis.perform(tmp_path_factory.mktemp("runs") / "all", "truth")
    assert not any(record["interrupted"] for record in records)
    return runs


def test_thirteen_statements_are_answered_for_both_columns(runs: thesis.Runs) -> None:
    rows = thesis_statements.ask(runs)
    pairs = [(row["id"], row["column"]) for row in rows]
    assert pairs == [(f"T{n}", column) for n in range(1, 14) for column in ("a", "b")]
    keys = {"id", "column", "statement", "expected", "got", "ok", "basis"}
    assert all(set(row) == keys for row in rows)
    basis = {row["id"]: row["basis"] for row in rows}
    assert [name for name in basis if basis[name] == "calibrated"] == ["T1", "T2"]
    assert [name for name in basis if basis[name] == "provoked"] == ["T7", "T12"]
    assert all(row["got"] and row["statement"] for row in rows)


def test_what_the_excerpt_does_not_state_is_not_judged(runs: thesis.Runs) -> None:
    rows = thesis_statements.ask(runs)
    silent = {(row["id"], row["column"]) for row in rows if row["ok"] is None}
    only_b = {(name, "a") for name in ("T8", "T9", "T10", "T11", "T12")}
    assert silent == only_b | {("T6", "b")}
    assert all((row["ok"] is None) == (row["expected"] is None) for row in rows)


def test_what_was_calibrated_holds_on_the_twin(runs: thesis.Runs) -> None:
    rows = {(row["id"], row["column"]): row["ok"] for row in thesis_statements.ask(runs)}
    assert rows["T1", "b"]
    assert rows["T2", "a"]
    assert rows["T2", "b"]


def test_mismatches_come_first(runs: thesis.Runs) -> None:
    text = thesis.markdown(thesis_statements.ask(runs))
    holds = [line.split("|")[-3].strip() for line in text.splitlines()[2:]]
    assert holds == sorted(holds, key=["**no**", "yes", "not stated"].index)


def test_the_figures_of_chapter_6_are_drawn_with_their_data(
    runs: thesis.Runs, tmp_path: Path
) -> None:
    pictures = thesis_figures.draw(runs, tmp_path)
    assert sorted(p.name for p in pictures) == [f"figure_6.{n}.png" for n in range(4, 9)]
    for picture in pictures:
        image = cv2.imread(str(picture))
        assert image is not None
        assert np.std(image) > 1  # something is on it
        rows = picture.with_suffix(".csv").read_text().splitlines()
        assert len(rows) > 25 * 19  # 25 frames a second, less the wait for the first


def test_the_play_of_column_a_knows_no_other_rig(runs: thesis.Runs) -> None:
    a, b = (runs[column]["circle-pi_hc"].compensation for column in ("a", "b"))
    assert abs(a).max() == pytest.approx(18.0)  # half of 0.2 of 180 deg
    assert abs(b).max() == pytest.approx(18.0)
