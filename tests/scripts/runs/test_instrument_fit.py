"""The fit of an instrument, from objects."""

from pathlib import Path

import numpy as np
import pytest

from endolock.control.transmission.quasi_static import Cable, Geometry
from endolock.control.transmission.simulation import simulate
from endolock.scripts.runs import handle_logs
from endolock.scripts.runs.instrument_fit import InstrumentFit
from endolock.twin.world import instrument_files

MADE = Cable(conduit_exponent=0.6, section_friction=0.18, stiffness=9e4, slack_m=-3e-3, sheath=0.08)


def test_the_base_can_be_an_object(tmp_path: Path) -> None:
    """Two periods of a triangle wave at 0.2 rad/s behind the model itself."""
    t = np.arange(0.0, 92.0, 0.1)
    handle = 2.3 * (1 - np.abs((0.2 * t / 2.3 + 1) % 4 - 2))
    nothing = np.zeros(len(t))
    bend, _ = simulate(MADE, Geometry(), handle, nothing, nothing)
    log = tmp_path / "bench.csv"
    columns = (handle_logs.TIME, *handle_logs.HANDLES, *handle_logs.BENDS)
    rows = np.column_stack([t, handle, nothing, bend, nothing])
    np.savetxt(log, rows, delimiter=",", header=",".join(columns), comments="")
    base = instrument_files.load("pretensioned")
    record = InstrumentFit(log=log, base=base, out=tmp_path / "found.toml").run()
    assert record.params["mu_wrap"].value == pytest.approx(0.6, rel=1e-3)  # without noise
    assert record.base == "Instrument"
    assert instrument_files.load(record.instrument).pulley_radius_m == base.pulley_radius_m
