"""Fits the transmission of an instrument to a slow log, and writes the instrument file.

record = InstrumentFit(log=Path("log")).run()
print(record.params["mu_wrap"].value, record.instrument)
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import degrees, radians
from pathlib import Path

from endolock.control.identification.fits import fit
from endolock.control.identification.uncertainty import Parameter
from endolock.control.transmission.quasi_static import Geometry
from endolock.hw import files
from endolock.hw.api import AXES, ConfigError
from endolock.scripts.runs import folder_contents, handle_logs
from endolock.twin.world import instrument_files
from endolock.twin.world.instrument import Instrument, Numerics
from endolock.twin.world.instrument_cable import geometry_of, with_cable

UNITS = {
    "mu_wrap": "1",
    "mu_section": "1",
    "k_over_K": "1/m2",
    "slack_m": "m",
    "pretension_over_K": "1/m",
    "sheath_over_K": "rad",
    "bending_stiffness": "N m/rad",
    "wire_stiffness": "N/m",
    "pretension_n": "N",
}
"""Units of the parameters, by name."""
LARGEST_SHAFT_DEG = 1080.0
"""Largest bend of the shaft [deg], the same as in a scenario."""
MARK = "# Written by endolock identify"
"""Start of the files that may be overwritten."""


@dataclass(frozen=True, kw_only=True)
class InstrumentRecord:
    """A fitted transmission, as the JSON of `endolock identify` holds it."""

    params: dict[str, Parameter]
    """Value, standard deviation, and whether the log determines it, by name; units in `UNITS`."""
    heldout_rms_deg: float
    """Error of the predicted bends in the last third, rms [deg]."""
    fit_rms_deg: float
    """Residual of the fitted bends, rms [deg]."""
    misfit: bool
    """Whether the residual is so far above the noise that the plant must be of another kind."""
    noise_deg: float
    """Noise of single bends [deg]."""
    play_heldout_rms_deg: float
    """Error of the best play of constant width in the last third, rms [deg]."""
    axis: str
    """Axis that was moved."""
    samples: int
    """Number of rows kept of the log."""
    shaft_deg: float
    """Bend of the shaft during the log [deg]."""
    base: str
    """Instrument for what was not fitted."""
    geometry: Geometry
    """Its dimensions, held constant."""
    wall_s: float
    """Wall-clock time of the fit [s]."""
    instrument: str
    """File of the fitted instrument."""
    damage: list[str]
    """What is missing or damaged in the run folder; the rest was fitted."""


@dataclass(frozen=True, kw_only=True)
class InstrumentFit:
    """Fit of the transmission to a slow log of handle angles and tip bends."""

    log: Path
    """A run folder with a pose tracker, or a CSV file; see `handle_logs.read`."""
    base: str | Path | Instrument = "pretensioned"
    """Instrument for what is not fitted, mainly the geometry: name, TOML file, or an instrument."""
    hinges: int = Numerics().hinges
    """Number of hinges of the section, both axes together."""
    shaft_deg: float | None = None
    """Bend of the shaft during the log [deg]; that of the run folder, or 180, if None."""
    out: Path | None = None
    """File for the fitted instrument; instrument.toml in the run folder, or NAME-instrument.toml
    beside NAME.csv, if None."""

    def run(self) -> InstrumentRecord:
        """Fit the log, and write the instrument file.

        Raises:
            ConfigError: the log cannot be fitted, or the file cannot be written.
        """
        base = instrument_files.load(self.base)
        geometry = geometry_of(base, self.hinges)
        log = handle_logs.read(self.log)
        shaft_deg = self._shaft_deg()
        file = self._instrument_file()
        start = time.perf_counter()
        found = fit(log, geometry)
        wall_s = time.perf_counter() - start
        own = isinstance(self.base, Instrument)
        record = InstrumentRecord(
            params=found.params,
            heldout_rms_deg=degrees(found.heldout_rms_rad),
            fit_rms_deg=degrees(found.fit_rms_rad),
            misfit=found.misfit,
            noise_deg=degrees(found.noise_rad),
            play_heldout_rms_deg=degrees(found.play_heldout_rms_rad),
            axis=AXES[log.axis],
            samples=found.samples,
            shaft_deg=shaft_deg,
            base=type(self.base).__name__ if own else str(self.base),
            geometry=geometry,
            wall_s=wall_s,
            instrument=str(file),
            damage=folder_contents.damage(self.log, "ticks") if self.log.is_dir() else [],
        )
        fitted = with_cable(base, found.cable, radians(shaft_deg), found.bending_stiffness)
        text = instrument_files.dump(fitted, _header(self.log, record))
        files.write_whole(file, text, "give another file")
        return record

    def _shaft_deg(self) -> float:
        if self.shaft_deg is not None:
            if not abs(self.shaft_deg) <= LARGEST_SHAFT_DEG:
                raise ConfigError(
                    f"--shaft-deg {self.shaft_deg:g} is out of range",
                    f"use {LARGEST_SHAFT_DEG:g} at most",
                )
            return self.shaft_deg
        if not self.log.is_dir():
            return 180.0
        scenario = folder_contents.configuration(self.log).get("scenario", {})
        return float(scenario.get("shaft_bend_deg", 180.0))

    def _instrument_file(self) -> Path:
        log = self.log
        beside = log.with_name(f"{log.stem}-instrument.toml")
        default = log / "instrument.toml" if log.is_dir() else beside
        file = self.out or default
        if file.suffix != ".toml":
            raise ConfigError(
                f"--out {file} does not end in .toml", "give a file name that ends in .toml"
            )
        if not file.parent.is_dir():
            raise ConfigError(f"--out {file}: there is no folder {file.parent}", "create it first")
        if file.exists() and not _ours(file):
            raise ConfigError(
                f"{file} exists and was not written by endolock identify", "give another --out"
            )
        return file


def _ours(file: Path) -> bool:
    try:
        return file.read_text("utf-8", errors="replace").startswith(MARK)
    except OSError:  # a folder, or not readable
        return False


def _header(log: Path, record: InstrumentRecord) -> str:
    fitted = []
    for name, figure in record.params.items():
        doubt = "" if figure.determined else ", not determined"
        fitted.append(f"  {name} {figure.value:.5g} +- {figure.std:.2g} {UNITS[name]}{doubt}")
    unknown = "" if "bending_stiffness" in record.params else ", and bending_stiffness"
    lines = [
        f"{MARK[2:]} from {log.name}: {record.axis}, shaft at {record.shaft_deg:g} deg.",
        f"Held-out last third {record.heldout_rms_deg:.3f} deg rms. Fitted:",
        *fitted,
        f"All other values are those of {record.base} and assumed to be true, including the",
        f"residual wrap by which mu_wrap gives conduit_friction{unknown}.",
        "Valid for this bend of the shaft. Sources named below are those of the default.",
    ]
    return "\n".join(lines)
