"""The benchmark page: what it runs, how it lays results out, and where it says the lock loses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from endolock.control.scores import ErrorSummary, HandleScores, TipScores
from endolock.hw.api import ConfigError
from endolock.scripts.runs import overrides, rigs
from endolock.scripts.runs.batch import FinishedRun
from endolock.scripts.runs.run_record import RunRecord
from endolock.scripts.studies import controller_benchmark as benchmark
from endolock.scripts.studies.benchmark_tables import SIMPLE, Planned, losses, tables

RECORD = RunRecord(
    overruns=0,
    frames=2500,
    frames_dropped=0,
    detected_fraction=1.0,
    lost_fraction=0.0,
    time_to_lock_s=1.0,
    error_px=ErrorSummary(rms=10.0, p95=20.0, max=30.0, mean=8.0),
    error_deg=None,
    delayed_error_px=ErrorSummary(),
    vision_error_px=None,
    handle=HandleScores(
        travel_rad=25.0, large_reversals_per_s=0.5, fast_share=0.02, p2p_deg=(10.0, 80.0)
    ),
    tip=TipScores(p2p_deg=(5.0, 42.0)),
    blur_px=0.0,
    scenario="straight",
    controller="pi",
    variation="",
    rig="twin",
    instrument="pretensioned",
    vision="truth",
    seed=0,
    duration_s=100.0,
    scored_from_s=50.0,
    wall_s=1.0,
    real_time_factor=100.0,
    latency_s=0.4,
    interrupted=False,
    needed_tip_deg=(4.0, 45.0),
    constant_px=ErrorSummary(rms=88.0, max=130.0),
    folder=Path(),
)


def finished(rms: float = 10.0, largest: float = 30.0, lost: float = 0.0) -> FinishedRun:
    error = ErrorSummary(rms=rms, p95=largest, max=largest, mean=rms)
    record = replace(RECORD, error_px=error, lost_fraction=lost)
    return FinishedRun(record, np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2)))


PARTS = [make() for make in benchmark.PARTS.values()]


def everywhere(**own: Any) -> dict[Planned, FinishedRun | None]:
    """Return results of all possible runs, the same but for those of the lock."""
    usual, lock = finished(), finished(**own)
    results: dict[Planned, FinishedRun | None] = {}
    for one in (one for part in PARTS for one in part.runs()):
        results[one] = lock if one.law == benchmark.LOCK else usual
        if one.law == "repetitive" and one.scenario in ("random", "breathing", "rest"):
            results[one] = None  # it needs a period
    return results


@pytest.mark.parametrize("part", PARTS, ids=list(benchmark.PARTS))
def test_every_part_compares_the_lock_with_the_simple_laws(part: Any) -> None:
    assert {*SIMPLE, benchmark.LOCK} <= set(part.laws)
    for case in part.cases:
        assert len(case.cells) == len(part.heads)
    benchmark.experiment(next(part.runs())).resolve()


def test_it_has_every_disturbance_and_every_plant_of_another_kind() -> None:
    _, targets, disturbances, _, plants = PARTS
    assert {case.vary[0] for case in disturbances.cases if case.vary} == set(overrides.names())
    assert {case.rig for case in plants.cases} == set(rigs.FIXED) - {"play"}
    assert len(plants.cases) == 3 * 6
    assert all(case.vary == ("camera.truth_noise_px=1",) for case in plants.cases)
    assert len(targets.cases) == 5


def test_no_run_is_made_twice_and_they_fit_into_an_hour() -> None:
    planned = {one for part in PARTS for one in part.runs()}
    slow = [one for one in planned if one.rig == "twin"]
    # 12 s each on one of two cores, and about a minute for some 70 of the lock: 58 minutes at most
    assert len(slow) <= 320
    nominal = Planned("straight", benchmark.LOCK)
    assert sum(nominal in set(part.runs()) for part in PARTS) == 3


def test_tables_hold_errors_motions_and_what_the_handles_did() -> None:
    (part, *_) = PARTS
    text = tables(part, everywhere(rms=2.6, largest=19.6), benchmark.experiment)
    rows = [line for line in text.splitlines() if line.startswith("| straight |")]
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    at = 1 + part.laws.index(benchmark.LOCK)
    assert [row[at] for row in cells] == ["2.6 / 20", "42 / 80", "0.50 / 0.50 / 2 %"]
    assert cells[0][1] == "10.0 / 30"
    assert cells[0][-2:] == ["88.0", "-"]
    assert cells[1][-1] == "45"


def test_a_run_that_is_lost_or_impossible_is_marked() -> None:
    (part, *_) = PARTS
    results = everywhere(lost=0.25)
    text = tables(part, results, benchmark.experiment)
    assert "10.0 / 30 (lost 25 %)" in text
    row = next(line for line in text.splitlines() if line.startswith("| random |"))
    assert row.strip("|").split("|")[1 + part.laws.index("repetitive")].strip() == "-"


@pytest.mark.parametrize(
    ("own", "said"),
    [
        ({"rms": 11.4}, None),  # 1.05 times 10 px and 1 px are 11.5 px
        ({"rms": 11.6}, "rms 11.6 px, `still` 10.0 px."),
        ({"largest": 39.4}, None),  # 1.15 times 30 px and 5 px are 39.5 px
        ({"largest": 39.6}, "max 39.6 px, `still` 30.0 px."),
        ({"rms": 1.0, "lost": 0.5}, "out of sight for 50 % of the time."),
    ],
)
def test_rows_in_which_the_lock_is_worse_are_listed(own: dict[str, float], said: str) -> None:
    rows = losses(PARTS, everywhere(**own), benchmark.LOCK)
    if said is None:
        assert rows == []
        return
    assert "- Scenarios, straight: " + said in rows
    tasks = {case.planned("") for part in PARTS for case in part.cases}
    assert len(rows) == len(tasks)  # each once


def test_the_best_of_the_simple_laws_counts_for_each_error_by_itself() -> None:
    results = everywhere(rms=9.0, largest=26.0)
    results[Planned("circle", "pi")] = finished(rms=5.0, largest=60.0)
    results[Planned("circle", "ik_sync")] = finished(rms=20.0, largest=15.0)
    (row,) = losses(PARTS, results, benchmark.LOCK)
    expected = "- Scenarios, circle: rms 9.0 px, `pi` 5.0 px; max 26.0 px, `ik_sync` 15.0 px."
    assert row == expected
    text = benchmark.where(PARTS, results)
    assert text.startswith(
        "\n## Where it loses\n\nRows in which `predictive_bank` has an rms above"
    )
    assert row in text
    assert "none of them" in benchmark.where(PARTS, everywhere())


def test_an_unknown_part_is_refused() -> None:
    with pytest.raises(ConfigError, match="part 'all' is unknown; use scenarios, targets, dist"):
        benchmark.main(["all"])
