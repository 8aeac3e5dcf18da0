"""The run record: what was run and what came of it, as `--json` and metrics.json hold it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from endolock.control.scores import ErrorSummary, Scores


@dataclass(frozen=True, kw_only=True)
class RunRecord(Scores):
    """Scores of a run, and what was run."""

    scenario: str
    """Its name."""
    controller: str
    """Its name; of a file its name without .py, of an object its class."""
    variation: str
    """Changes by `--vary`, joined by +; empty where there are none."""
    rig: str
    """What was driven, such as twin or serial:PORT."""
    instrument: str
    """Its name or file."""
    vision: str
    """markers, track or truth."""
    seed: int
    duration_s: float
    """From the first tick to the last [s]."""
    scored_from_s: float
    """What came before is left out of the scores [s]."""
    wall_s: float
    """Wall-clock time that the run took [s]."""
    real_time_factor: float | None
    """Simulated time over wall-clock time [1]; None where nothing was run."""
    latency_s: float | None
    """Exposure to delivery of a frame [s]."""
    interrupted: bool
    """Whether a Ctrl-C or a kill ended it early."""
    needed_tip_deg: list[float] | None
    """Peak-to-peak bend (up_down, left_right) of a tip that always points at the target, in the
    scored part [deg]; None on a bench."""
    constant_px: ErrorSummary | None
    """Error of the best constant bend, known in hindsight [px]; None on a bench, and where the tip
    is pushed."""
    folder: Path
    """The run folder; not part of the JSON."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values by name, as `--json` and metrics.json hold them."""
        values = asdict(self)
        scores = [field.name for field in fields(Scores)]
        first = [name for name in values if name not in (*scores, "folder")]
        return {name: values[name] for name in (*first, *scores)}
