"""`endolock identify`: from a slow log of handle and tip to the parameters of the transmission."""

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
"""As in a scenario."""
MARK = "# Written by endolock identify"
"""First words of the files that may be written again."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Fit the transmission to a slow log of handle angles and tip bends."""

    log: tyro.conf.Positional[Path]
    """A run folder with a pose tracker, as endolock hysteresis --out leaves it, or a CSV file with
    the columns t_s, handle_up_down_rad, handle_left_right_rad, tip_up_down_rad, tip_left_right_rad
    and, if measured at the handle, tension_up_n, _right_n, _down_n, _left_n."""
    base: str = "pretensioned"
    """Instrument that gives what is not fitted, its geometry above all: a name or a TOML file."""
    hinges: int = Numerics().hinges
    """Hinges of the section, both axes together."""
    shaft_deg: tyro.conf.DisallowNone[float | None] = None
    """Bend of the shaft during the log [deg]; else the run folder's, or 180."""
    out: tyro.conf.DisallowNone[Path | None] = None
    """File for the fitted instrument; else instrument.toml in the run folder, or beside the CSV
    file with its name and -instrument.toml."""
    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write the figures there as JSON; - prints them, and nothing else, on standard output."""


def main(request: Request) -> int:
    """Carry out `endolock identify`; return the exit code."""
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
    """Fit, and write the instrument's file.

    Returns:
        The record: params {name: {value, std, determined}}, heldout_rms_deg, and besides.

    Raises:
        ConfigError: the log cannot be fitted, or the file not be written; nothing was.
    """
    base = instrument_files.load(request.base)
    geometry = geometry_of(base, request.hinges)
    log = handle_logs.read(request.log)
    shaft_deg = _shaft_deg(request)
    target = _target(request)
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
        "instrument": str(target),
    }
    fitted = with_cable(base, found.cable, radians(shaft_deg), found.bending_stiffness)
    text = instrument_files.dump(fitted, _header(request, record))
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(
            f"cannot write {target}: {error.strerror}", "give another --out"
        ) from None
    return record


def table(record: dict[str, Any]) -> Table:
    """Lay a record out for people."""
    result = Table(box=box.SIMPLE_HEAD, padding=(0, 2, 0, 0), title_justify="left")
    result.title = f"transmission of {record['axis']}, shaft at {record['shaft_deg']:g} deg"
    for heading in ("parameter", "value", "+-", "unit", ""):
        result.add_column(heading, justify="right" if heading in ("value", "+-") else "left")
    for name, told in record["params"].items():
        known = "" if told["determined"] else "not determined"
        result.add_row(name, f"{told['value']:.4g}", f"{told['std']:.2g}", UNITS[name], known)
    result.caption = (
        f"held-out last third: {record['heldout_rms_deg']:.2f} deg rms (fitted part "
        f"{record['fit_rms_deg']:.2f}, noise {record['noise_deg']:.2f}; best play of constant "
        f"width {record['play_heldout_rms_deg']:.2f}), {record['samples']} samples"
    )
    if record["misfit"]:
        result.caption += (
            "\nthe fit leaves more than the noise: that plant works in another way, or has another "
            "geometry; nothing is determined"
        )
    result.caption_justify = "left"
    return result


def _shaft_deg(request: Request) -> float:
    if request.shaft_deg is not None:
        if not abs(request.shaft_deg) <= LARGEST_SHAFT_DEG:
            raise ConfigError(
                f"--shaft-deg {request.shaft_deg:g} is no bend of a shaft",
                f"give {LARGEST_SHAFT_DEG:g} at most",
            )
        return request.shaft_deg
    if not request.log.is_dir():
        return 180.0
    told = run_folder.configuration(request.log).get("scenario", {})
    return float(told.get("shaft_bend_deg", 180.0))


def _target(request: Request) -> Path:
    log = request.log
    beside = log.with_name(f"{log.stem}-instrument.toml")
    usual = log / "instrument.toml" if log.is_dir() else beside
    target = request.out or usual
    if target.suffix != ".toml":
        raise ConfigError(f"--out {target}: give a file that ends in .toml")
    if not target.parent.is_dir():
        raise ConfigError(f"--out {target}: there is no folder {target.parent}", "make it first")
    if target.exists() and not _ours(target):
        raise ConfigError(f"{target} exists and is not ours", "give another file with --out")
    return target


def _ours(target: Path) -> bool:
    try:
        return target.read_text("utf-8", errors="replace").startswith(MARK)
    except OSError:  # a folder, or not for us to read
        return False


def _header(request: Request, record: dict[str, Any]) -> str:
    fitted = []
    for name, told in record["params"].items():
        doubt = "" if told["determined"] else ", not determined"
        fitted.append(f"  {name} {told['value']:.5g} +- {told['std']:.2g} {UNITS[name]}{doubt}")
    unknown = "" if "bending_stiffness" in record["params"] else ", and bending_stiffness"
    lines = [
        f"{MARK[2:]} from {request.log.name}: {record['axis']}, shaft at "
        f"{record['shaft_deg']:g} deg.",
        f"Held-out last third {record['heldout_rms_deg']:.3f} deg rms. Fitted:",
        *fitted,
        f"Everything else is that of {request.base} and held to be true; so is the residual wrap,",
        f"by which conduit_friction follows from mu_wrap{unknown}.",
        "Good for this bend of the shaft. A source named below is that of the default.",
    ]
    return "\n".join(lines)
