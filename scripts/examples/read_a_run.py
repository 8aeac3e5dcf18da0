"""Log a run, then read its tables back: handle travel and the largest tension of each wire."""

import tempfile
from pathlib import Path

import numpy as np

from endolock.scripts.commands import run
from endolock.scripts.runs import run_folder

with tempfile.TemporaryDirectory() as place:
    out = Path(place) / "run"
    request = run.Request(scenario="straight", vision="truth", duration_s=4, out=out)
    record, folder = run.perform(request, show_progress=False)
    ticks = run_folder.read(folder, "ticks")

position = np.array(ticks["position_rad"].to_pylist())
tension = np.array(ticks["tension_section_n"].to_pylist())
print("handle travel [rad]:", np.abs(np.diff(position, axis=0)).sum(axis=0).round(3))
print("largest tension up, right, down, left [N]:", tension.max(axis=0).round(1))
