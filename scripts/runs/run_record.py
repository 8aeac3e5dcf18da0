"""The run record: what was run and its scores, as `--json` and metrics.json hold them."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from endolock.control.scores import ErrorSummary, Scores


@dataclass(frozen=True, kw_only=True)
class RunRecord(Scores):
    """What was run, and its scores."""

    scenario: str
    """Name of the scenario."""
    controller: str
    """Name of the controller; for a file its name without .py, for an object that of its class or
    of the function that made it."""
    variation: str
    """Changes by `--vary`, joined by +; empty without changes."""
    rig: str
    """Name of the rig, such as twin or serial:PORT; for an object that of its class."""
    instrument: str
    """Name or file of the instrument; for an object that of its class."""
    vision: str
    """markers, track or truth; for an object the name of its class."""
    seed: int
    """Seed of all random numbers."""
    duration_s: float
    """From the first tick to the last [s]."""
    scored_from_s: float
    """Time from which the run is scored [s]."""
    wall_s: float
    """Wall-clock duration of the run [s]."""
    real_time_factor: float | None
    """Simulated time over wall-clock time [1]; None in the rows of a constant handle angle."""
    latency_s: float | None
    """Exposure to delivery of a frame [s]."""
    timestep_error_deg: float | None = None
    """Largest difference of a bend between the time step and a quarter of it, on a fixed drive
    [deg]; above 0.5 the results depend on the step. None where it is not checked: without physics,
    and for the instruments and numerics that come with the package, which converge."""
    interrupted: bool
    """Whether a Ctrl-C or a kill ended the run early."""
    needed_tip_deg: tuple[float, ...] | None
    """Peak-to-peak bend (up_down, left_right) of a tip that always points at the target, in the
    scored part [deg]; None on a bench."""
    constant_px: ErrorSummary | None
    """Error of the best constant bend, known in hindsight [px]; None on a bench, and where the tip
    is pushed."""
    folder: Path
    """The run folder; not part of the JSON."""

    @property
    def travel_rad_s(self) -> float | None:
        """Distance that both handles travel per second of the scored part [rad/s]."""
        scored_s = self.duration_s - self.scored_from_s
        if self.handle.travel_rad is None or scored_s <= 0:
            return None
        return self.handle.travel_rad / scored_s

    def as_dict(self) -> dict[str, Any]:
        """Return plain values by name, as `--json` and metrics.json hold them."""
        values = asdict(self)
        scores = [field.name for field in fields(Scores)]
        first = [name for name in values if name not in (*scores, "folder")]
        return {name: values[name] for name in (*first, *scores)}
