"""The figure of errors over time."""

from pathlib import Path

import pytest

from endolock.scripts.figures import error_figure
from endolock.scripts.runs.experiment import Experiment


def test_the_figure_shows_the_metric(tmp_path: Path) -> None:
    request = Experiment(scenario="straight", vision="truth", duration_s=2.0, out=tmp_path / "run")
    record = request.run()
    folder = record.folder
    t, error = error_figure.error_over_time(folder)
    assert t[0] == 0
    assert max(error) == pytest.approx(record.as_dict()["error_px"]["max"])
