"""A run read back from its folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
from pydantic import TypeAdapter, ValidationError

from endolock.hw.api import ConfigError
from endolock.scripts.runs import folder_contents
from endolock.scripts.runs.run_record import RunRecord


@dataclass(frozen=True, kw_only=True)
class LoggedRun:
    """Contents of a run folder; scripts/runs/log_tables.py lists the columns of its tables.

    Example:
        position = np.array(read_run("runs/mine").ticks["position_rad"].to_pylist())
    """

    folder: Path
    """Path of the run folder."""
    configuration: dict[str, Any]
    """run.toml: the experiment, all resolved values, and the versions of the packages."""
    ticks: pa.Table
    """One row per control period."""
    frames: pa.Table
    """One row per delivered frame."""
    record: RunRecord | None
    """metrics.json; None where the run was killed before it was written, or it is damaged."""
    damage: tuple[str, ...] = ()
    """What is missing or damaged in the folder."""


def read_run(folder: str | Path) -> LoggedRun:
    """Read a run folder; of a killed run, everything up to the last complete group of rows.

    What is missing or damaged becomes a `DamageWarning`; what is whole is read.

    Raises:
        ConfigError: it is not a run folder, or was written by a version with other columns.
    """
    path = Path(folder)
    return LoggedRun(
        folder=path,
        configuration=folder_contents.configuration(path),
        ticks=folder_contents.read(path, "ticks"),
        frames=folder_contents.read(path, "frames"),
        record=_record(path),
        damage=tuple(folder_contents.damage(path)),
    )


def _record(folder: Path) -> RunRecord | None:
    values = folder_contents.metrics(folder)
    if values is None:
        return None
    try:
        return TypeAdapter(RunRecord).validate_python({**values, "folder": folder})
    except ValidationError as error:
        wrong = error.errors()[0]
        raise ConfigError(
            f"{folder / 'metrics.json'} was written by endolock "
            f"{folder_contents.written_by(folder)} and is not a run record of this version: "
            f"{wrong['loc'][0]}: {wrong['msg']}",
            folder_contents.how_to_read(folder),
        ) from None
