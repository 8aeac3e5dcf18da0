"""Measures the lost motion between handle and tip on a simulated rig, at several bends.

record = HysteresisMeasurement(axis="up_down", shaft_deg=180.0).run()
print(record["width"]["30"], record["deadband_rad"])
"""

from __future__ import annotations

import time
from contextlib import nullcontext
from dataclasses import dataclass, fields, replace
from math import degrees, radians
from pathlib import Path
from typing import Any, Literal, NamedTuple

from rich.console import Console
from rich.progress import track

from endolock.hw.api import AXES, ConfigError
from endolock.scripts.runs import hysteresis_widths, rigs, run_folder, step_dependence
from endolock.scripts.runs.hysteresis_protocol import SPEED_RAD_S, Protocol, RecordedStrokes
from endolock.scripts.runs.progress import progress
from endolock.scripts.runs.stopping import closing
from endolock.twin.world import instrument_files
from endolock.twin.world import scenario as scenarios
from endolock.twin.world.instrument import NUMERICS, Instrument, Numerics
from endolock.twin.world.scenario import Scenario
from endolock.twin.world.scenario_sections import PoseTrackerSettings

MAP_OWN_DEG = tuple(range(0, 91, 10))
MAP_OTHER_DEG = (0, 15, 30, 45, 60, 75)
MAP_SHAFT_DEG = tuple(range(0, 361, 45))
"""Points of the maps: own bend, bend of the other axis, and bend of the shaft [deg]."""
USUAL_CREST_RAD = 2.8
"""Usual handle angle of the crests [rad], for the progress bar."""


class MeasuredStrokes(NamedTuple):
    """Strokes of one measurement, and how they were reached."""

    strokes: RecordedStrokes
    other_axis_rad: float
    """Bend of the other axis [rad]."""
    simulated_s: float
    """Duration on the rig's clock [s]."""


LARGEST_BEND_DEG = 360.0
"""Largest bend of the other axis that is tried [deg]: twice what any endoscope reaches."""


@dataclass(frozen=True, kw_only=True)
class HysteresisMeasurement:
    """Slow strokes of one axis in front of a pose tracker.

    Example:
        >>> HysteresisMeasurement(shaft_deg=90.0).scenario().shaft_bend_deg
        90.0
    """

    axis: Literal["up_down", "left_right"] = "up_down"
    """Handle that turns."""
    other_axis_deg: float = 0.0
    """Bend of the other axis, reached first and held [deg]."""
    shaft_deg: float = 180.0
    """Bend of the shaft [deg]."""
    instrument: str | Path | Instrument = "pretensioned"
    """Name, TOML file, or an instrument."""
    numerics: Literal["default", "fast", "fidelity"] = "default"
    """Numerics of the simulation."""
    rig: str = "twin"
    """Name of a rig with a pose tracker, see `rigs.RIGS`."""
    noise_deg: float = PoseTrackerSettings().rotation_noise_deg
    """Noise of the pose tracker about each axis, standard deviation [deg]."""
    map: bool = False
    """Also measure the width over own and other bend, and over the bend of the shaft."""
    seed: int = 0
    """Seed of the tracker's noise."""
    out: Path | None = None
    """Run folder of the strokes, new or empty; None: nothing is written."""

    def scenario(self) -> Scenario:
        """Return the scenario `rest` with a bent shaft and a pose tracker.

        Raises:
            ConfigError: a value is out of range.
        """
        if not abs(self.other_axis_deg) <= LARGEST_BEND_DEG:
            raise ConfigError(
                f"--other-axis-deg {self.other_axis_deg:g}", "use a number of degrees, such as 60"
            )
        watched = {
            "shaft_bend_deg": self.shaft_deg,
            "tracker.rotation_noise_deg": self.noise_deg,
        }
        return scenarios.load("rest", watched)

    @property
    def timestep_error_deg(self) -> float | None:
        """How much bends depend on the time step, see `step_dependence.error_deg` [deg]."""
        return step_dependence.error_deg(self.rig, *self._simulated)

    @property
    def notes(self) -> tuple[str, ...]:
        """What should be known of it before it runs, each in one line."""
        dependent = step_dependence.note(self.timestep_error_deg, *self._simulated)
        return (dependent,) if dependent else ()

    @property
    def _simulated(self) -> tuple[Scenario, Instrument, Numerics]:
        numerics = NUMERICS[self.numerics]
        return self.scenario(), instrument_files.load(self.instrument), numerics

    def run(self, *, show_progress: bool = False) -> dict[str, Any]:
        """Run the protocol and compute its figures; with `out`, write a run folder.

        Args:
            show_progress: whether to show a progress bar.

        Returns:
            The record: width, deadband_rad, max_bend_deg, drift_deg_per_min, loop, and more.

        Raises:
            ConfigError: it cannot be measured; nothing was written.
            HardwareError: the handles stopped.
        """
        start = time.perf_counter()
        measured = self.strokes(show_progress=show_progress)
        record: dict[str, Any] = {
            **hysteresis_widths.figures(measured.strokes),
            "axis": self.axis,
            "other_axis_deg": degrees(measured.other_axis_rad),
            "shaft_deg": self.shaft_deg,
            "instrument": self._instrument_name,
            "numerics": self.numerics,
            "noise_deg": self.noise_deg,
            "seed": self.seed,
            "timestep_error_deg": self.timestep_error_deg,
        }
        if self.map:
            record |= self._maps(show_progress)
        record["simulated_s"] = measured.simulated_s
        record["wall_s"] = time.perf_counter() - start
        return record

    def strokes(self, *, whole: bool = True, show_progress: bool = False) -> MeasuredStrokes:
        """Run the protocol once.

        Args:
            whole: False to record only the loop, without a run folder.
            show_progress: whether to show a progress bar.

        Raises:
            ConfigError: it cannot be measured; nothing was written.
            HardwareError: the handles stopped.
        """
        if self.rig.startswith(rigs.SERIAL):
            raise ConfigError(
                "a bench has no pose tracker",
                "use --rig twin or hil, or log strokes as a CSV file for endolock identify",
            )
        rig, _ = rigs.make(
            self.rig,
            self.scenario(),
            vision="truth",
            instrument=instrument_files.load(self.instrument),
            numerics=self.numerics,
            seed=self.seed,
        )
        quarters = 15.0 if whole else 5.0
        expected_s = quarters * USUAL_CREST_RAD / SPEED_RAD_S + (32.0 if whole else 0.0)
        with (
            closing() as stop,
            rig,
            progress("strokes", round(expected_s), show_progress, stop) as report,
        ):
            protocol = Protocol(rig, AXES.index(self.axis), report)
            other_axis_rad = protocol.bend_other_axis(radians(self.other_axis_deg))
            folder = None
            if self.out and whole:
                configuration = {"hysteresis": self._described(), **rig.describe()}
                folder = run_folder.RunFolder(self.out, configuration)
            with folder or nullcontext():
                strokes = protocol.run(folder, whole=whole)
            return MeasuredStrokes(strokes, other_axis_rad, rig.clock.now())

    def _maps(self, show_progress: bool) -> dict[str, Any]:
        """Measure the width over own and other bend, and at 30 deg over the bend of the shaft."""
        others = [replace(self, other_axis_deg=float(deg)) for deg in MAP_OTHER_DEG]
        shafts = [replace(self, shaft_deg=float(d), other_axis_deg=0.0) for d in MAP_SHAFT_DEG]
        loops: list[RecordedStrokes | None] = []
        bar = track(
            others + shafts,
            "a loop for each point of the maps",
            console=Console(stderr=True),
            disable=not show_progress,
        )
        for point in bar:
            try:
                loops.append(point.strokes(whole=False).strokes)
            except ConfigError:  # the other axis does not reach this bend: no figures for this row
                loops.append(None)
        beside, bent = loops[: len(others)], loops[len(others) :]
        width_at, deadband_of = hysteresis_widths.width_at, hysteresis_widths.deadband_of
        return {
            "map": {
                "own_deg": list(MAP_OWN_DEG),
                "other_deg": list(MAP_OTHER_DEG),
                "width": [
                    [width_at(loop, own) if loop else None for own in MAP_OWN_DEG]
                    for loop in beside
                ],
            },
            "shaft_map": {
                "shaft_deg": list(MAP_SHAFT_DEG),
                "width_at_30": [width_at(loop, 30) if loop else None for loop in bent],
                "deadband_rad": [deadband_of(loop) if loop else None for loop in bent],
            },
        }

    @property
    def _instrument_name(self) -> str:
        own = isinstance(self.instrument, Instrument)
        return type(self.instrument).__name__ if own else str(self.instrument)

    def _described(self) -> dict[str, Any]:
        """Return the fields as plain values for run.toml."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        del values["map"]
        values["instrument"] = self._instrument_name
        return {k: str(v) if isinstance(v, Path) else v for k, v in values.items()}
