"""The run folder: two append-only tables, what was run, and what came out.

    run.toml        resolved configuration and versions
    ticks.arrows    one row per control period
    frames.arrows   one row per delivered frame, with its pictures as JPEG
    metrics.json    the run record; the last thing written
    bus.log         every byte of the line to the handles, where there is one

The tables are Arrow IPC streams: rows are appended and never touched again, and `read` takes a
stream that ends anywhere, so a killed run is readable up to its last complete group of rows: that
of the last frame with a picture; without pictures, of the last ten rows. Everything else about a
run is derived from this folder.
"""

from __future__ import annotations

import contextlib
import json
import platform
import tomllib
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from math import isfinite
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import tomli_w

from endolock.control.loop import Seen, Tick
from endolock.hw import files
from endolock.hw.api import ConfigError, Image, Plant, Pose, TruthSample

BUS_LOG = "bus.log"
"""Every byte of the line to the handles, where there is one; see hw/dynamixel/bus_log.py."""
PACKAGES = ("endolock", "mujoco", "numpy", "opencv-python-headless", "pyarrow")
"""Whose versions go into run.toml."""
JPEG_QUALITY = 75
GROUP = 10
"""Rows written together where no frame carries a picture: one by one they would cost more than the
physics."""


def _vector(n: int) -> pa.DataType:
    """N numbers; a pose is a position and a quaternion."""
    return pa.list_(pa.float64(), n)


TICKS = pa.schema(
    [
        ("t", pa.float64()),
        ("skipped", pa.int32()),
        ("command_rad", _vector(2)),
        ("state_t", pa.float64()),
        ("position_rad", _vector(2)),
        ("velocity_rad_s", _vector(2)),
        ("current_a", _vector(2)),
        ("target_rad", _vector(2)),
        ("clipped", pa.list_(pa.int8(), 2)),
        ("fresh", pa.bool_()),
        ("mode", pa.string()),
        ("device_tick", pa.int64()),
        ("status", pa.string()),
        ("signals", pa.map_(pa.string(), pa.float64())),  # of the law's inside
        # From a tracker; null without one.
        ("tracked_t", pa.float64()),
        ("tracked_pose", _vector(7)),
        # The truth now; null on hardware.
        ("target_px", _vector(2)),
        ("in_picture", pa.bool_()),
        ("distance_m", pa.float64()),
        ("error_deg", pa.float64()),
        ("bend_rad", _vector(2)),
        ("tension_handle_n", _vector(4)),
        ("tension_section_n", _vector(4)),
    ]
)
FRAMES = pa.schema(
    [
        ("seq", pa.int64()),
        ("t_capture", pa.float64()),
        ("t_available", pa.float64()),
        ("dropped", pa.int32()),
        ("repeated", pa.bool_()),
        ("status", pa.string()),
        ("why", pa.string()),
        ("target_px", _vector(2)),
        ("covariance_px2", _vector(3)),
        ("distance_m", pa.float64()),
        # Where markers see a target that is followed without them; else null.
        ("reference_px", _vector(2)),
        ("corners_px", pa.list_(_vector(2))),
        # The truth at the exposure; null on hardware.
        ("true_t", pa.float64()),
        ("true_target_px", _vector(2)),
        ("true_distance_m", pa.float64()),
        ("tip_pose", _vector(7)),
        ("board_pose", _vector(7)),
        ("backbone_m", pa.list_(_vector(3))),
        ("tip_jpeg", pa.binary()),
        ("overview_jpeg", pa.binary()),
    ]
)


class _Table:
    """One growing Arrow stream."""

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self._path = path
        self._file = pa.OSFile(str(path), "wb")  # every write goes to the system at once
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
            with contextlib.suppress(OSError):  # without its end mark a table reads as cut off
                self._writer.close()
        finally:
            with contextlib.suppress(OSError):
                self._file.close()


class RunFolder:
    """Writes one run; nothing but the folder is made before the first row.

    Args:
        path: a new or empty folder.
        configuration: what goes into run.toml, with the versions in use; None values are left out.

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
            raise ConfigError(f"folder {str(path)!r} is no readable name", "give another") from None
        except OSError as error:
            raise ConfigError(
                f"cannot write to {path}: {error.strerror}", "give another folder with --out"
            ) from None

    def tick(self, tick: Tick) -> None:
        """Append one control period."""
        s = tick.state
        row: dict[str, Any] = {
            "t": tick.t,
            "skipped": tick.skipped,
            "command_rad": tick.command.position if tick.command else None,
            "state_t": s.t,
            "position_rad": s.position,
            "velocity_rad_s": s.velocity,
            "current_a": s.current,
            "target_rad": s.goal,
            "clipped": s.clipped,
            "fresh": s.fresh,
            "mode": s.mode,
            "device_tick": s.device_tick,
            "status": tick.status,
            "signals": list(tick.signals.items()),
        }
        if tick.tracked:
            row |= {"tracked_t": tick.tracked.t, "tracked_pose": _pose(tick.tracked)}
        if tick.truth:
            row |= _truth_of_tick(tick.truth, tick.truth.plant)
        self._ticks.append(row)

    def seen(self, seen: Seen) -> None:
        """Append one frame with its pictures."""
        frame, observation, truth = seen.frame, seen.observation, seen.truth
        judged = isfinite(observation.reference_px[0])
        row: dict[str, Any] = {
            "seq": frame.seq,
            "t_capture": frame.t_capture,
            "t_available": frame.t_available,
            "dropped": frame.dropped,
            "repeated": frame.repeated,
            "status": observation.status,
            "why": observation.why,
            "target_px": observation.target_px,
            "covariance_px2": observation.covariance,
            "distance_m": observation.distance_m,
            "reference_px": observation.reference_px if judged else None,
            "corners_px": observation.corners_px,
            "tip_jpeg": jpeg(frame.image),
            "overview_jpeg": jpeg(seen.overview.image) if seen.overview else None,
        }
        if truth:
            row |= {
                "true_t": truth.t,
                "true_target_px": truth.target_px,
                "true_distance_m": truth.distance_m,
                "tip_pose": _pose(truth.plant.tip),
                "board_pose": _pose(truth.plant.board),
                "backbone_m": list(truth.plant.backbone),
            }
        self._frames.append(row)
        if frame.image is not None:
            self._ticks.flush()
            self._frames.flush()

    def close(self) -> None:
        """Complete both tables."""
        try:
            self._ticks.close()
        finally:
            self._frames.close()

    def finish(self, metrics: Mapping[str, Any]) -> None:
        """Write metrics.json, whole or not at all."""
        text = json.dumps(metrics, indent=2, allow_nan=False) + "\n"
        files.write_whole(self.path / "metrics.json", text, "make room, or give another --out")


def new_path(base: Path, name: str) -> Path:
    """Return a folder below `base` that does not exist, named by time and `name`."""
    stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
    path, n = base / f"{stamp}-{name}", 1
    while path.exists():
        n += 1
        path = base / f"{stamp}-{name}-{n}"
    return path


def read(path: Path, table: str) -> pa.Table:
    """Read a table of a run folder, up to its last complete row where the run was cut off.

    Args:
        path: the run folder.
        table: "ticks" or "frames".

    Raises:
        ConfigError: there is no such table in the folder.
    """
    file = path / f"{table}.arrows"
    wanted = {"ticks": TICKS, "frames": FRAMES}[table]
    batches: list[pa.RecordBatch] = []
    try:
        if file.stat().st_size == 0:  # killed before the first rows
            return wanted.empty_table()
        with pa.OSFile(str(file)) as source:
            stream = pa.ipc.open_stream(source)
            if not stream.schema.equals(wanted):
                _refuse(file, stream.schema, wanted)
            # Cut off within a group of rows, the stream ends in an error: it was never complete.
            with contextlib.suppress(pa.ArrowInvalid, OSError):
                batches.extend(iter(stream))
    except FileNotFoundError:
        raise ConfigError(
            f"no run in {path}: {file.name} is missing", "give a run folder"
        ) from None
    except (pa.ArrowInvalid, OSError) as error:
        raise ConfigError(f"cannot read {file}: {error}", "give a run folder") from None
    return pa.Table.from_batches(batches, wanted)


def _refuse(file: Path, found: pa.Schema, wanted: pa.Schema) -> None:
    """Say whether a table with other columns is from another version, or something else."""
    if wanted.names[0] not in found.names:
        raise ConfigError(f"{file} is not a table of {file.stem}", "give a run folder")
    version_there = written_by(file.parent)
    missing = ", ".join(name for name in wanted.names if name not in found.names)
    what = f"has no column {missing}" if missing else "has other columns"
    raise ConfigError(
        f"{file} was written by endolock {version_there} and {what}", "read it with that version"
    )


def written_by(path: Path) -> str:
    """Return the version of endolock that wrote a run folder; "?" where run.toml does not say."""
    try:
        return str(tomllib.loads((path / "run.toml").read_text("utf-8"))["versions"]["endolock"])
    except (OSError, ValueError, KeyError, TypeError):
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


def jpeg(image: Image | None) -> bytes | None:
    """Encode an RGB picture."""
    if image is None:
        return None
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    done, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not done:
        raise RuntimeError(f"OpenCV could not encode a picture of {image.shape}")
    return bytes(data)


def decode(data: bytes) -> Image:
    """Decode a JPEG to RGB."""
    bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if bgr is None:
        raise ConfigError("a picture in the run folder is no JPEG", "the folder is damaged")
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


def _truth_of_tick(truth: TruthSample, plant: Plant) -> dict[str, Any]:
    return {
        "target_px": truth.target_px,
        "in_picture": truth.in_picture,
        "distance_m": truth.distance_m,
        "error_deg": truth.error_deg,
        "bend_rad": plant.bend_rad,
        "tension_handle_n": plant.tension_handle_n,
        "tension_section_n": plant.tension_section_n,
    }


def _pose(pose: Pose) -> tuple[float, ...]:
    return (*pose.position, *pose.quaternion)


def _versions() -> dict[str, str]:
    return {p: version(p) for p in PACKAGES} | {"python": platform.python_version()}


def _without_none(value: Any) -> Any:
    """TOML knows no null: leave such keys out."""
    if isinstance(value, Mapping):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_without_none(v) for v in value]
    return value
