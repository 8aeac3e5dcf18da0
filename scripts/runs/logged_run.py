"""A run read back from its folder."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
from pydantic import TypeAdapter, ValidationError

from endolock.hw.api import ConfigError
from endolock.scripts.runs import run_folder
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
    """metrics.json; None where the run was killed before it was written."""


def read_run(folder: str | Path) -> LoggedRun:
    """Read a run folder; of a killed run, everything up to the last complete group of rows.

    Raises:
        ConfigError: it is not a run folder, or was written by a version with other columns.
    """
    path = Path(folder)
    return LoggedRun(
        folder=path,
        configuration=run_folder.configuration(path),
        ticks=run_folder.read(path, "ticks"),
        frames=run_folder.read(path, "frames"),
        record=_record(path),
    )


def _record(folder: Path) -> RunRecord | None:
    file = folder / "metrics.json"
    if not file.exists():
        return None
    try:
        values = json.loads(file.read_text(encoding="utf-8"))
        return TypeAdapter(RunRecord).validate_python({**values, "folder": folder})
    except (OSError, ValueError, TypeError) as error:
        if not isinstance(error, ValidationError):
            raise ConfigError(f"cannot read {file}: {error}", "give a run folder") from None
        wrong = error.errors()[0]
        raise ConfigError(
            f"{file} was written by endolock {run_folder.written_by(folder)} and is not a run "
            f"record of this version: {wrong['loc'][0]}: {wrong['msg']}",
            run_folder.how_to_read(folder),
        ) from None
