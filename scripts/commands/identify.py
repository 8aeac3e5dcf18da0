"""`endolock identify`: parameters of the transmission from a slow log of handle and tip."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated

import tyro
from rich import box
from rich.console import Console
from rich.table import Table

from endolock.scripts.runs import output
from endolock.scripts.runs.instrument_fit import UNITS, InstrumentFit, InstrumentRecord
from endolock.twin.world import instrument_files
from endolock.twin.world.instrument import Numerics

BASE = (
    "Instrument for what is not fitted, mainly the geometry: "
    f"{', '.join(instrument_files.names())}, or a TOML file of that form."
)


@dataclass(frozen=True, kw_only=True)
class Request:
    """Fit the transmission to a slow log of handle angles and tip bends."""

    log: tyro.conf.Positional[Path]
    """A run folder with a pose tracker, as endolock hysteresis --out writes it, or a CSV file with
    the columns t_s, handle_up_down_rad, handle_left_right_rad, tip_up_down_rad, tip_left_right_rad
    and, if measured at the handle, tension_up_n, _right_n, _down_n, _left_n."""
    base: Annotated[str, tyro.conf.arg(help=BASE)] = "pretensioned"
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
    values = {field.name: getattr(request, field.name) for field in fields(InstrumentFit)}
    with Console(stderr=True).status("fitting; some seconds for a minute of strokes"):
        record = InstrumentFit(**values).run()
    output.write_json(asdict(record), request.json)
    if request.json != "-":
        console.print(table(record))
        console.print(f"instrument: {record.instrument}", soft_wrap=True, highlight=False)
    return 0


def table(record: InstrumentRecord) -> Table:
    """Lay out a record as a table."""
    result = Table(box=box.SIMPLE_HEAD, padding=(0, 2, 0, 0), title_justify="left")
    result.title = f"transmission of {record.axis}, shaft at {record.shaft_deg:g} deg"
    for heading in ("parameter", "value", "+-", "unit", ""):
        result.add_column(heading, justify="right" if heading in ("value", "+-") else "left")
    for name, figure in record.params.items():
        known = "" if figure.determined else "not determined"
        result.add_row(name, f"{figure.value:.4g}", f"{figure.std:.2g}", UNITS[name], known)
    result.caption = (
        f"held-out last third: {record.heldout_rms_deg:.2f} deg rms (fitted part "
        f"{record.fit_rms_deg:.2f}, noise {record.noise_deg:.2f}; best play of constant "
        f"width {record.play_heldout_rms_deg:.2f}), {record.samples} samples"
    )
    if record.misfit:
        result.caption += (
            "\nthe residual is larger than the noise: the plant works differently or has another "
            "geometry; nothing is determined"
        )
    result.caption_justify = "left"
    return result
