"""The run folder: two append-only tables, the configuration, and the scores.

    run.toml        resolved configuration and versions
    ticks.arrows    one row per control period
    frames.arrows   one row per delivered frame, with its pictures as JPEG
    metrics.json    the run record; the last thing written
    bus.log         every byte on the serial line to the handles, if there is one

The tables are Arrow IPC streams: rows are appended and never changed, and `read` accepts a
stream that ends anywhere, so a killed run is readable up to its last complete group of rows. A
group ends at each frame with a picture; without pictures it has ten rows. Everything else about a
run is derived from this folder.
"""

from __future__ import annotations

import contextlib
import json
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pyarrow as pa
import tomli_w

import endolock
from endolock.control.loop import Seen, Tick
from endolock.hw import files
from endolock.hw.api import ConfigError
from endolock.hw.lifecycle import Closing, close_all
from endolock.scripts.runs.log_tables import FRAMES, TICKS, frame_row, tick_row

BUS_LOG = "bus.log"
"""Every byte on the serial line to the handles, if there is one; see hw/dynamixel/bus_log.py."""
PACKAGES = ("mujoco", "numpy", "opencv-python-headless", "pyarrow")
"""Packages whose versions go into run.toml, after that of endolock."""
GROUP = 10
"""Rows written together in runs without pictures: single writes would take longer than the
physics."""


class _Table:
    """One growing Arrow stream."""

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self._path = path
        self._file = pa.OSFile(str(path), "wb")  # unbuffered
        self._schema = schema
        self._writer = pa.ipc.new_stream(self._file, schema)
        self._rows: list[Mapping[str, Any]] = []

    def append(self, row: Mapping[str, Any]) -> None:
        self._rows.append(row)
        if len(self._rows) >= GROUP:
            self.flush()

    def flush(self) -> None:
        rows, self._rows = self._rows, []
        if not rows:
            return
        try:
            self._writer.write_batch(pa.RecordBatch.from_pylist(rows, self._schema))
        except OSError as error:
            raise ConfigError(
                f"cannot write {self._path}: {error.strerror or error}",
                "make room, or give another folder with --out",
            ) from error

    def close(self) -> None:
        try:
            self.flush()
            with contextlib.suppress(OSError):  # without its end mark a table is read as truncated
                self._writer.close()
        finally:
            with contextlib.suppress(OSError):
                self._file.close()


class RunFolder(Closing):
    """Writes the run folder of one run.

    Args:
        path: a new or empty folder.
        configuration: goes into run.toml, with the versions in use; None values are left out.

    Raises:
        ConfigError: the folder cannot be used.
    """

    def __init__(self, path: Path, configuration: Mapping[str, Any]) -> None:
        self.path = path
        try:
            text = tomli_w.dumps(_without_none({**configuration, "versions": _versions()})).encode()
            path.mkdir(parents=True, exist_ok=True)
            if any(path.iterdir()):
                raise ConfigError(f"folder {path} is not empty", "give a new one with --out")
            (path / "run.toml").write_bytes(text)
            self._ticks = _Table(path / "ticks.arrows", TICKS)
            self._frames = _Table(path / "frames.arrows", FRAMES)
        except UnicodeError:
            raise ConfigError(f"folder {str(path)!r} is not a valid name", "give another") from None
        except OSError as error:
            raise ConfigError(
                f"cannot write to {path}: {error.strerror}", "give another folder with --out"
            ) from None

    def tick(self, tick: Tick) -> None:
        """Append one control period."""
        self._ticks.append(tick_row(tick))

    def seen(self, seen: Seen) -> None:
        """Append one frame with its pictures."""
        self._frames.append(frame_row(seen))
        if seen.frame.image is not None:
            self._ticks.flush()
            self._frames.flush()

    def close(self) -> None:
        """Complete both tables."""
        close_all(self._ticks.close, self._frames.close)

    def finish(self, metrics: Mapping[str, Any]) -> None:
        """Write metrics.json, whole or not at all."""
        text = json.dumps(metrics, indent=2, allow_nan=False) + "\n"
        files.write_whole(self.path / "metrics.json", text, "make room, or give another --out")


def new_path(base: Path, name: str) -> Path:
    """Return the path of a new folder below `base`, named by time and `name`."""
    stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
    path, n = base / f"{stamp}-{name}", 1
    while path.exists():
        n += 1
        path = base / f"{stamp}-{name}-{n}"
    return path


def read(path: Path, table: str) -> pa.Table:
    """Read a table of a run folder; of a killed run, up to its last complete group of rows.

    Args:
        path: the run folder.
        table: "ticks" or "frames".

    Raises:
        ConfigError: there is no such table in the folder.
    """
    file = path / f"{table}.arrows"
    schema = {"ticks": TICKS, "frames": FRAMES}[table]
    batches: list[pa.RecordBatch] = []
    try:
        if file.stat().st_size == 0:  # killed before the first rows
            return schema.empty_table()
        with pa.OSFile(str(file)) as source:
            stream = pa.ipc.open_stream(source)
            if not stream.schema.equals(schema):
                _refuse(file, stream.schema, schema)
            # A stream cut off within a group of rows ends in an error; that group is dropped.
            with contextlib.suppress(pa.ArrowInvalid, OSError):
                batches.extend(iter(stream))
    except FileNotFoundError:
        raise ConfigError(
            f"no run in {path}: {file.name} is missing", "give a run folder"
        ) from None
    except (pa.ArrowInvalid, OSError) as error:
        raise ConfigError(f"cannot read {file}: {error}", "give a run folder") from None
    return pa.Table.from_batches(batches, schema)


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


def configuration(path: Path) -> dict[str, Any]:
    """Read run.toml of a run folder.

    Raises:
        ConfigError: it is missing or damaged.
    """
    file = path / "run.toml"
    if not file.exists():
        raise ConfigError(f"no run in {path}: run.toml is missing", "give a run folder")
    values = files.read_toml(file, "run", "give a run folder")
    if missing := {"calibration", "board"} - values.keys():
        raise ConfigError(f"{file} has no [{missing.pop()}]", "give a run folder")
    return values


def _versions() -> dict[str, str]:
    packages = {p: version(p) for p in PACKAGES}
    return {"endolock": endolock.__version__, **packages, "python": platform.python_version()}


def _without_none(value: Any) -> Any:
    """Leave out keys with the value None: TOML has no null."""
    if isinstance(value, Mapping):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_without_none(v) for v in value]
    return value
