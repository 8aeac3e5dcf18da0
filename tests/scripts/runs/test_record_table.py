"""Run records as tables on a terminal of 80 characters."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from endolock import Experiment
from endolock.control.scores import HandleScores
from endolock.scripts.runs import record_table
from endolock.scripts.runs.run_record import RunRecord


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> RunRecord:
    out: Path = tmp_path_factory.mktemp("run") / "run"
    plain = Experiment(scenario="circle", rig="play", controller="pi", vision="truth", out=out)
    return replace(plain, duration_s=4.0, scored_from_s=2.0).run()


def printed(records: list[RunRecord]) -> list[str]:
    stream = io.StringIO()
    Console(width=80, file=stream).print(record_table.handles(records))
    return stream.getvalue().splitlines()


def test_what_the_handles_did_is_printed_beside_the_errors(record: RunRecord) -> None:
    scores = HandleScores(
        travel_rad=3.0, reversals_per_s=1.234, large_reversals_per_s=0.5, fast_share=0.02
    )
    known = replace(record, handle=scores)
    assert known.travel_rad_s == pytest.approx(1.5, rel=0.02)  # of two seconds, but for a tick
    lines = printed([known, replace(record, handle=HandleScores())])
    assert lines[0].strip().startswith("handles: travel [rad/s]")
    rows = [line.split() for line in lines if line.strip().startswith("circle")]
    assert rows[0] == ["circle", "pi", f"{known.travel_rad_s:.2f}", "1.23", "0.50", "2", "%"]
    assert rows[1] == ["circle", "pi", "-", "-", "-", "-"]


def test_what_differs_between_runs_has_a_column_and_it_fits(record: RunRecord) -> None:
    long = replace(
        record,
        controller="predictive_bank",
        variation="jitter",
        seed=1,
        latency_s=0.8,
    )
    lines = printed([record, long])
    assert max(map(len, lines)) <= 80
    heads = " ".join(lines[:5])
    assert all(name in heads for name in ("seed", "latency", "reversals", "large", "fast"))
