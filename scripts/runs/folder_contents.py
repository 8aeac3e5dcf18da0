"""What is in a run folder, and what in it is damaged.

All that is whole is read. What is missing or damaged becomes a `DamageWarning`, once for each
reading, and is listed by `damage`; only a folder without run.toml or without tables is refused.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import pyarrow as pa

from endolock.hw import files
from endolock.hw.api import ConfigError
from endolock.hw.dynamixel import bus_log
from endolock.hw.errors import DamageWarning
from endolock.scripts.runs import sealed_table, sealed_text
from endolock.scripts.runs.log_tables import FRAMES, TICKS, completed, forms
from endolock.scripts.runs.sealed_table import Group

BUS_LOG = "bus.log"
"""Every byte on the serial line to the handles, if there is one; see hw/dynamixel/bus_log.py."""
TABLES = {"ticks": TICKS, "frames": FRAMES}
"""Columns of the tables, by name; see log_tables.py."""


class _Table(NamedTuple):
    """A table that was looked through: where its rows are, and what is missing."""

    file: Path
    form: pa.Schema
    """Its columns in the file."""
    groups: list[Group]
    """Groups of a sealed table."""
    unsealed: list[pa.RecordBatch]
    """Rows of a table of an earlier version, without seals."""
    damage: list[str]

    def batches(self) -> Iterator[pa.RecordBatch]:
        """Yield the rows group by group, with all columns of this version."""
        schema = TABLES[self.file.stem]
        for batch in self.unsealed:
            yield completed(batch, schema)
        if self.groups:
            with self.file.open("rb") as file:
                for group in self.groups:
                    yield completed(sealed_table.batch_of(file, group, self.form), schema)


def read(path: Path, table: str) -> pa.Table:
    """Read a table of a run folder, up to its end or the last complete group of rows.

    Args:
        path: the run folder.
        table: "ticks" or "frames".

    Raises:
        ConfigError: it is missing, has other columns, or is not a table.
    """
    return pa.Table.from_batches(batches(path, table), TABLES[table])


def batches(path: Path, table: str) -> Iterator[pa.RecordBatch]:
    """Read a table as `read` does, group by group.

    Raises:
        ConfigError: it is missing, has other columns, or is not a table.
    """
    found = _table(path, table)
    _warn(found.damage)
    return found.batches()


def bus_records(path: Path) -> list[bus_log.Chunk]:
    """Read the log of the serial line in a run folder.

    Raises:
        ConfigError: there is none.
    """
    found = bus_log.records(path / BUS_LOG)
    _warn(_bus_damage(path, found))
    return list(found.values())


def configuration(path: Path) -> dict[str, Any]:
    """Read run.toml of a run folder.

    Raises:
        ConfigError: it is missing or damaged.
    """
    file = path / "run.toml"
    if not file.exists():
        raise ConfigError(f"no run in {path}: run.toml is missing", "give a run folder")
    values = files.read_toml(file, "run", "give a run folder")
    if not sealed_text.is_whole(file.read_bytes()):
        raise ConfigError(
            f"{file} was changed since it was written",
            "restore it, or remove its first and last line to use it as it is",
        )
    if missing := {"calibration", "board"} - values.keys():
        raise ConfigError(f"{file} has no [{missing.pop()}]", "give a run folder")
    _warn(_run_damage(path))
    return values


def metrics(path: Path) -> dict[str, Any] | None:
    """Read metrics.json of a run folder; None where the run was killed, or the file is damaged."""
    values, said = _metrics(path)
    _warn(said)
    return values


def damage(path: Path, *parts: str) -> list[str]:
    """List what is missing or damaged in a run folder.

    Args:
        path: the run folder.
        parts: "ticks", "frames" and "bus" are looked through if they are among these; if none is
            given, all that there are.

    Raises:
        ConfigError: a table is missing, has other columns, or is not a table.
    """
    said = _metrics(path)[1] + _run_damage(path)
    for part in parts or [*TABLES, "bus"]:
        if part != "bus":
            said += _table(path, part).damage
        elif (path / BUS_LOG).exists():
            said += _bus_damage(path, bus_log.records(path / BUS_LOG))
    return said


def how_to_read(path: Path) -> str:
    """Say what to do with a run folder of another form."""
    if written_by(path) == version("endolock"):
        return "it is damaged, or of an earlier state of this version; run it again"
    return "read it with that version"


def written_by(path: Path) -> str:
    """Return the version of endolock that wrote a run folder; "?" where run.toml does not say."""
    try:
        return str(files.read_toml(path / "run.toml", "run", "")["versions"]["endolock"])
    except (ConfigError, KeyError, TypeError):
        return "?"


def _warn(said: list[str]) -> None:
    for text in said:
        warnings.warn(text, DamageWarning, stacklevel=4)


def _table(path: Path, table: str) -> _Table:
    file, schema = path / f"{table}.arrows", TABLES[table]
    try:
        with file.open("rb") as source:
            groups, form = _groups(source, schema)
            sealed = bool(groups) or sealed_table.is_sealed(source) or _expects_seals(path)
            if not sealed:
                return _Table(file, form, [], _unsealed(file, schema), [])
            if groups and not groups[0].number:
                found = sealed_table.schema_of(source, groups.pop(0))
                if not any(found.equals(known) for known in forms(schema)):
                    _refuse(file, found, schema)
    except FileNotFoundError:
        raise ConfigError(
            f"no run in {path}: {file.name} is missing", "give a run folder"
        ) from None
    except OSError as error:
        raise ConfigError(
            f"cannot read {file}: {error.strerror or error}", "give a run folder"
        ) from None
    stated = _stated(path, table)
    missing = sealed_table.damage(groups, stated.rows)
    if not missing and groups:
        missing = stated.exchanged(f"{sealed_table.crc_of(groups):08x}")
    return _Table(file, form, groups, [], [f"{file} {text}" for text in missing])


def _groups(source: BinaryIO, schema: pa.Schema) -> tuple[list[Group], pa.Schema]:
    """Find the whole groups of a sealed table, and its columns: of this version or of another."""
    for form in forms(schema):
        groups = sealed_table.groups(source, form)
        if any(group.number for group in groups):
            return groups, form
    return groups, schema


def _unsealed(file: Path, schema: pa.Schema) -> list[pa.RecordBatch]:
    """Read a table of an earlier version, which ends anywhere."""
    batches: list[pa.RecordBatch] = []
    if file.stat().st_size == 0:  # killed before the first rows
        return batches
    try:
        with pa.OSFile(str(file)) as source:
            stream = pa.ipc.open_stream(source)
            if not any(stream.schema.equals(known) for known in forms(schema)):
                _refuse(file, stream.schema, schema)
            # A stream cut off within a group of rows ends in an error; that group is dropped.
            with suppress(pa.ArrowInvalid, OSError):
                for batch in stream:
                    batch.validate(full=True)
                    batches.append(batch)
    except (pa.ArrowException, OSError) as error:
        raise ConfigError(f"cannot read {file}: {error}", "give a run folder") from None
    return batches


def _refuse(file: Path, found: pa.Schema, schema: pa.Schema) -> None:
    """Raise the error for a table with other columns: of another version, or not of a run."""
    if schema.names[0] not in found.names:
        raise ConfigError(f"{file} is not a table of {file.stem}", "give a run folder")
    missing = ", ".join(name for name in schema.names if name not in found.names)
    what = f"has no column {missing}" if missing else "has other columns"
    raise ConfigError(
        f"{file} was written by endolock {written_by(file.parent)} and {what}",
        how_to_read(file.parent),
    )


def _expects_seals(path: Path) -> bool:
    """Whether the run folder was written by a version that seals its tables."""
    try:
        return sealed_text.is_sealed((path / "run.toml").read_bytes())
    except OSError:
        return False


def _metrics(path: Path) -> tuple[dict[str, Any] | None, list[str]]:
    """Return the values of metrics.json, and what is wrong with them."""
    file = path / "metrics.json"
    try:
        data = file.read_bytes()
        values = json.loads(data.decode("utf-8"))
    except FileNotFoundError:
        return None, []
    except (OSError, ValueError) as error:
        return None, [f"{file} is damaged and was not used: {error}"]
    if not isinstance(values, dict) or not sealed_text.is_whole(data):
        return None, [f"{file} is damaged and was not used: it was changed since it was written"]
    return values, []


class _Stated(NamedTuple):
    """What metrics.json states for a part of a run; None where it does not say."""

    rows: int | None
    crc: str | None

    def exchanged(self, crc: str) -> list[str]:
        """Say so if the check sum of the part is another, though both are whole."""
        if self.crc is None or self.crc == crc:
            return []
        return ["and metrics.json are not of the same run"]


def _stated(path: Path, part: str) -> _Stated:
    values = _metrics(path)[0] or {}
    rows, sums = (
        kept.get(part) if isinstance(kept, dict) else None
        for kept in (values.get("rows"), values.get("sums"))
    )
    return _Stated(rows if isinstance(rows, int) else None, sums)


def _run_damage(path: Path) -> list[str]:
    file = path / "run.toml"
    try:
        crc = sealed_text.sum_in(file.read_bytes())
    except OSError:
        return []
    return [f"{file} {text}" for text in (_stated(path, "run").exchanged(crc) if crc else [])]


def _bus_damage(path: Path, found: dict[int, bus_log.Chunk]) -> list[str]:
    file, stated = path / BUS_LOG, _stated(path, "bus")
    if said := bus_log.damage(found, stated.rows):
        return [f"{file}: {text}" for text in said]
    return [f"{file} {text}" for text in stated.exchanged(f"{bus_log.crc_of(found):08x}")]
