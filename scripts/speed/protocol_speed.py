"""Speed of the protocols: hysteresis, and the fit of its log."""

from __future__ import annotations

import tempfile
from pathlib import Path

from endolock.scripts.runs.hysteresis_measurement import HysteresisMeasurement
from endolock.scripts.runs.instrument_fit import InstrumentFit


def protocols() -> dict[str, float]:
    """Measure the wall time of `endolock hysteresis` and of `endolock identify` on its log [s]."""
    with tempfile.TemporaryDirectory() as name:
        log_folder = Path(name) / "log"
        measured = HysteresisMeasurement(out=log_folder).run()
        fitted = InstrumentFit(log=log_folder).run()
    return {"hysteresis_s": measured["wall_s"], "identify_s": fitted.wall_s}
