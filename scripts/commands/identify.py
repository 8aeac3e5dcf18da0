"""`endolock identify`: parameters of the transmission from a slow log of handle and tip."""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import degrees, radians
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich import box
from rich.console import Console
from rich.table import Table

from endolock.control.identification.fits import fit
from endolock.hw.api import AXES, ConfigError
from endolock.scripts.runs import handle_logs, output, run_folder
from endolock.twin.world import instrument_files
from endolock.twin.world.instrument import Numerics
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
LARGEST_SHAFT_DEG = 1080.0
"""Largest bend of the shaft [deg], the same as in a scenario."""
MARK = "# Written by endolock identify"
"""Start of the files that may be overwritten."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Fit the transmission to a slow log of handle angles and tip bends."""

    log: tyro.conf.Positional[Path]
    """A run folder with a pose tracker, as endolock hysteresis --out writes it, or a CSV file with
    the columns t_s, handle_up_down_rad, handle_left_right_rad, tip_up_down_rad, tip_left_right_rad
    and, if measured at the handle, tension_up_n, _right_n, _down_n, _left_n."""
    base: str = "pretensioned"
    """Instrument for what is not fitted, mainly the geometry: a name or a TOML file."""
    hinges: int = Numerics().hinges
    """Number of hinges of the section, both axes together."""
    shaft_deg: tyro.conf.DisallowNone[float | None] = None
    """Bend of the shaft during the log [deg]; by default that of the run folder, or 180."""
    out: tyro.conf.DisallowNone[Path | None] = None
    """File for the fitted instrument; by default instrument.toml in the run folder, or
    NAME-instrument.toml beside NAME.csv."""
    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write the record to a file as JSON; - prints only the JSON on standard output."""


def main(request: Request) -> int:
    """Run `endolock identify`; return the exit code."""
    output.check_json(request.json)
    console = Console(stderr=request.json == "-")
    with Console(stderr=True).status("fitting; some seconds for a minute of strokes"):
        record = perform(request)
    output.write_json(record, request.json)
    if request.json != "-":
        console.print(table(record))
        console.print(f"instrument: {record['instrument']}", soft_wrap=True, highlight=False)
    return 0


def perform(request: Request) -> dict[str, Any]:
    """Fit the log, and write the instrument file.

    Returns:
        The record: params {name: {value, std, determined}}, heldout_rms_deg, and more.

    Raises:
        ConfigError: the log cannot be fitted, or the file cannot be written.
    """
    base = instrument_files.load(request.base)
    geometry = geometry_of(base, request.hinges)
    log = handle_logs.read(request.log)
    shaft_deg = _shaft_deg(request)
    file = _instrument_file(request)
    start = time.perf_counter()
    found = fit(log, geometry)
    wall_s = time.perf_counter() - start
    record = {
        "params": {name: vars(parameter) for name, parameter in found.params.items()},
        "heldout_rms_deg": degrees(found.heldout_rms_rad),
        "fit_rms_deg": degrees(found.fit_rms_rad),
        "misfit": found.misfit,
        "noise_deg": degrees(found.noise_rad),
        "play_heldout_rms_deg": degrees(found.play_heldout_rms_rad),
        "axis": AXES[log.axis],
        "samples": found.samples,
        "shaft_deg": shaft_deg,
        "base": request.base,
        "geometry": vars(geometry),
        "wall_s": wall_s,
        "instrument": str(file),
    }
    fitted = with_cable(base, found.cable, radians(shaft_deg), found.bending_stiffness)
    text = instrument_files.dump(fitted, _header(request, record))
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write {file}: {error.strerror}", "give another --out") from None
    return record


def table(record: dict[str, Any]) -> Table:
    """Lay out a record as a table."""
    result = Table(box=box.SIMPLE_HEAD, padding=(0, 2, 0, 0), title_justify="left")
    result.title = f"transmission of {record['axis']}, shaft at {record['shaft_deg']:g} deg"
    for heading in ("parameter", "value", "+-", "unit", ""):
        result.add_column(heading, justify="right" if heading in ("value", "+-") else "left")
    for name, figure in record["params"].items():
        known = "" if figure["determined"] else "not determined"
        result.add_row(name, f"{figure['value']:.4g}", f"{figure['std']:.2g}", UNITS[name], known)
    result.caption = (
        f"held-out last third: {record['heldout_rms_deg']:.2f} deg rms (fitted part "
        f"{record['fit_rms_deg']:.2f}, noise {record['noise_deg']:.2f}; best play of constant "
        f"width {record['play_heldout_rms_deg']:.2f}), {record['samples']} samples"
    )
    if record["misfit"]:
        result.caption += (
            "\nthe residual is larger than the noise: the plant works differently or has another "
            "geometry; nothing is determined"
        )
    result.caption_justify = "left"
    return result


def _shaft_deg(request: Request) -> float:
    if request.shaft_deg is not None:
        if not abs(request.shaft_deg) <= LARGEST_SHAFT_DEG:
            raise ConfigError(
                f"--shaft-deg {request.shaft_deg:g} is out of range",
                f"use {LARGEST_SHAFT_DEG:g} at most",
            )
        return request.shaft_deg
    if not request.log.is_dir():
        return 180.0
    scenario = run_folder.configuration(request.log).get("scenario", {})
    return float(scenario.get("shaft_bend_deg", 180.0))


def _instrument_file(request: Request) -> Path:
    log = request.log
    beside = log.with_name(f"{log.stem}-instrument.toml")
    default = log / "instrument.toml" if log.is_dir() else beside
    file = request.out or default
    if file.suffix != ".toml":
        raise ConfigError(f"--out {file} does not end in .toml", "give a file that does")
    if not file.parent.is_dir():
        raise ConfigError(f"--out {file}: there is no folder {file.parent}", "make it first")
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


def _header(request: Request, record: dict[str, Any]) -> str:
    fitted = []
    for name, figure in record["params"].items():
        doubt = "" if figure["determined"] else ", not determined"
        fitted.append(f"  {name} {figure['value']:.5g} +- {figure['std']:.2g} {UNITS[name]}{doubt}")
    unknown = "" if "bending_stiffness" in record["params"] else ", and bending_stiffness"
    lines = [
        f"{MARK[2:]} from {request.log.name}: {record['axis']}, shaft at "
        f"{record['shaft_deg']:g} deg.",
        f"Held-out last third {record['heldout_rms_deg']:.3f} deg rms. Fitted:",
        *fitted,
        f"All other values are those of {request.base} and assumed to be true, including the",
        f"residual wrap by which mu_wrap gives conduit_friction{unknown}.",
        "Valid for this bend of the shaft. Sources named below are those of the default.",
    ]
    return "\n".join(lines)
