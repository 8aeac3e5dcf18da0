"""The ablation's table: its rows and columns can be run, and a cell says what it should."""

from __future__ import annotations

import pytest

from endolock.scripts.runs import batch
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.studies import ablation


@pytest.mark.parametrize("column", ablation.CASES)
def test_every_column_can_be_run_with_every_row(column: str) -> None:
    case = ablation.CASES[column]
    for law, changes in ablation.WITHOUT.values():
        ablation.experiment(law, changes, case).resolve()


def test_a_row_without_a_mechanism_differs_from_the_whole_in_it_alone() -> None:
    changes = [changes for law, changes in ablation.WITHOUT.values() if law == "predictive_bank"]
    assert changes[0] == ()
    assert len(set(changes)) == len(changes)
    assert all(change.endswith("=false") for row in changes for change in row)


def test_a_cell_is_error_and_large_reversals() -> None:
    (one,) = batch.all_of(
        [
            Experiment(
                scenario="rest", rig="play", vision="truth", duration_s=4.0, controller="still"
            )
        ]
    )
    assert ablation._cell(one) == "0.0 / 0.00"
