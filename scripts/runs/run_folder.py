"""The run folder: two append-only tables, the configuration, and the scores.

    run.toml        resolved configuration and versions
    ticks.arrows    one row per control period
    frames.arrows   one row per delivered frame, with its pictures as JPEG
    metrics.json    the run record, the number of rows and the check sum of each table; the last
                    thing written
    bus.log         every byte on the serial line to the handles, if there is one

The tables are Arrow IPC streams: rows are appended in sealed groups and never changed, so a killed
run is readable up to its last complete group of rows, and damage is found before it is read (see
sealed_table.py and sealed_text.py). A group ends at each frame with a picture; without pictures it
has ten rows. Everything else about a run is derived from this folder; `folder_contents` reads it.
"""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from importlib.metadata import version
from itertools import count
from pathlib import Path
from typing import Any

import endolock
from endolock.control.loop import Seen, Tick
from endolock.hw import files
from endolock.hw.api import ConfigError
from endolock.hw.dynamixel import bus_log
from endolock.hw.lifecycle import Closing, close_all
from endolock.scripts.runs import sealed_text
from endolock.scripts.runs.folder_contents import BUS_LOG as BUS_LOG
from endolock.scripts.runs.folder_contents import configuration as configuration
from endolock.scripts.runs.folder_contents import read as read
from endolock.scripts.runs.log_tables import FRAMES, TICKS, frame_row, tick_row
from endolock.scripts.runs.sealed_table import TableWriter

PACKAGES = ("mujoco", "numpy", "opencv-python-headless", "pyarrow")
"""Packages whose versions go into run.toml, after that of endolock."""
GROUP = 10
"""Rows written together in runs without pictures: single writes would take longer than the
physics."""


class RunFolder(Closing):
    """Writes the run folder of one run.

    Args:
        path: a new or empty folder.
        configuration: goes into run.toml, with the versions in use; None values are left out.

    Raises:
        ConfigError: the folder cannot be used.
    """

    def __init__(self, path: Path, configuration: Mapping[str, Any]) -> None:
        self.path = path.absolute()  # a law may change the working folder
        try:
            text = sealed_text.toml(_without_none({**configuration, "versions": _versions()}))
            path.mkdir(parents=True, exist_ok=True)
            if any(path.iterdir()):
                raise FileExistsError
            with (path / "run.toml").open("xb") as file:  # only one of two runs at once
                file.write(text)
            self._ticks = TableWriter(path / "ticks.arrows", TICKS, GROUP)
            self._frames = TableWriter(path / "frames.arrows", FRAMES, GROUP)
        except UnicodeError:
            raise ConfigError(f"folder {str(path)!r} is not a valid name", "give another") from None
        except FileExistsError:
            what = "is not empty" if path.is_dir() else "is a file"
            raise ConfigError(f"folder {path} {what}", "give a new one") from None
        except OSError as error:
            raise ConfigError(
                f"cannot write to {path}: {error.strerror}", "give another folder"
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
        """Complete both tables, and write metrics.json, whole or not at all."""
        self.close()
        rows = {"ticks": self._ticks.rows, "frames": self._frames.rows}
        sums = {"ticks": f"{self._ticks.crc:08x}", "frames": f"{self._frames.crc:08x}"}
        if of_run := sealed_text.sum_in((self.path / "run.toml").read_bytes()):
            sums["run"] = of_run
        log = self.path / BUS_LOG
        if log.exists():
            found = bus_log.records(log)
            rows["bus"], sums["bus"] = len(found), f"{bus_log.crc_of(found):08x}"
        text = sealed_text.json_({**metrics, "sums": sums}, rows)
        files.write_whole(self.path / "metrics.json", text, "make room, or give another folder")


def new_path(base: Path, name: str) -> Path:
    """Make a new folder below `base`, named by time and `name`; return its path.

    Raises:
        ConfigError: it cannot be made.
    """
    stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
    for n in count(1):
        path = base / (f"{stamp}-{name}" if n == 1 else f"{stamp}-{name}-{n}")
        try:
            base.mkdir(parents=True, exist_ok=True)
            path.mkdir()  # one of several runs that begin at once gets it
        except FileExistsError:
            if not base.is_dir():
                raise ConfigError(f"{base} is a file", "move it away") from None
            continue
        except OSError as error:
            raise ConfigError(
                f"cannot write to {base}: {error.strerror}", "give another folder"
            ) from None
        return path
    raise AssertionError


@contextmanager
def series_folder(given: Path | None, base: Path, name: str) -> Iterator[Path]:
    """Give the folder of several runs: the one given, or a new one, removed if it stays empty.

    Args:
        given: folder that the user chose, or None.
        base: parent of a new one.
        name: end of the name of a new one.

    Raises:
        ConfigError: it cannot be made.
    """
    existed = base.exists()
    path = given or new_path(base, name)
    try:
        yield path
    finally:
        if given is None:
            with suppress(OSError):  # not empty
                path.rmdir()
                if not existed:
                    base.rmdir()


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
