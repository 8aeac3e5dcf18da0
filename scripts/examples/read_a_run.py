"""Run, then read the tables of the run folder: handle travel, largest tension of each wire."""

import tempfile
from pathlib import Path

import numpy as np

from endolock import Experiment, read_run

with tempfile.TemporaryDirectory() as temporary:
    out = Path(temporary) / "run"
    Experiment(scenario="straight", vision="truth", duration_s=4, out=out).run()
    ticks = read_run(out).ticks

position = np.array(ticks["position_rad"].to_pylist())
tension = np.array(ticks["tension_section_n"].to_pylist())
print("handle travel [rad]:", np.abs(np.diff(position, axis=0)).sum(axis=0).round(3))
print("largest tension up, right, down, left [N]:", tension.max(axis=0).round(1))
