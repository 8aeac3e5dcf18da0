"""Reads logs of handle angles and tip bends: run folders with a pose tracker, and CSV files."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from difflib import get_close_matches
from math import degrees, pi
from pathlib import Path

import numpy as np
import pyarrow as pa

from endolock.control.identification.fits import STEP_RAD
from endolock.control.identification.handle_log import HandleLog
from endolock.control.transmission.simulation import thin
from endolock.hw.api import AXES, ConfigError, Vector
from endolock.hw.rotation import to_vector
from endolock.hw.strict import shown
from endolock.scripts.runs import run_folder

TIME = "t_s"
HANDLES = tuple(f"handle_{axis}_rad" for axis in AXES)
BENDS = tuple(f"tip_{axis}_rad" for axis in AXES)
TENSIONS = tuple(f"tension_{wire}_n" for wire in ("up", "right", "down", "left"))
"""Columns of a CSV file; the four tensions, at the handle, are optional."""

LARGEST_HANDLE_RAD = 4 * pi
LARGEST_BEND_RAD = 1.2 * pi
"""Larger numbers cannot be radians."""
LARGEST_TENSION_N = 5000.0
"""Larger numbers cannot be newtons in a wire of an endoscope."""
MOST_ROWS = 1_000_000
"""Most rows of a log [1]: 2.7 hours at 100 Hz. Assumed."""
GAP_S = 0.5
"""Longest time without a row [s]; ten rows if they are further apart."""
LEAST_TRAVEL_RAD = 0.3
LEAST_BEND_RAD = np.radians(10.0)
"""Smallest motion of handle and tip to either side [rad]."""
LEAST_CORRELATION = 0.5
"""Smallest correlation of bend and handle, as of a loop half as wide as the handle's range [1]."""
LEAST_TURNS = 3
"""Smallest number of reversals, so that the first two thirds contain strokes in both directions."""


def read(source: Path) -> HandleLog:
    """Read and check a log.

    Args:
        source: a run folder whose rig had a pose tracker, or a CSV file.

    Raises:
        ConfigError: it is not a log, does not contain enough motion, or has impossible values.
    """
    log = _folder(source) if source.is_dir() else _table(source)
    try:
        _check(log)
    except ConfigError as error:
        raise ConfigError(f"{source}: {error.what}", error.next_step) from None
    return log


def _folder(source: Path) -> HandleLog:
    """Read a run folder; handle angles are interpolated to the times of the tracker's poses."""
    ticks: pa.Table = run_folder.read(source, "ticks")
    columns = ticks["tracked_t"].to_pylist(), ticks["tracked_pose"].to_pylist()
    tracked = {t: pose for t, pose in zip(*columns, strict=True) if t is not None}
    if not tracked:
        raise ConfigError(
            f"{source} has no poses from a tracker",
            "record some with endolock hysteresis --out DIR, or use a scenario with a [tracker]",
        )
    times, vectors = np.array(list(tracked)), []
    for _x, _y, _z, *quaternion in tracked.values():
        vectors.append(to_vector(tuple(quaternion)))
    known = np.array(ticks["state_t"].to_pylist())
    handles = np.array(ticks["position_rad"].to_pylist())
    handle = np.column_stack([np.interp(times, known, column) for column in handles.T])
    return HandleLog(times, handle, np.array(vectors)[:, :2])


def _rows(source: Path) -> Iterator[list[str]]:
    """Yield the rows of a CSV file."""
    try:
        with source.open(newline="", encoding="utf-8-sig") as file:
            yield from csv.reader(file)
    except FileNotFoundError:
        raise ConfigError(f"no log at {source}", "give a run folder or a CSV file") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{source} is not UTF-8 text", "give a CSV file") from None
    except (OSError, csv.Error) as error:
        raise ConfigError(
            f"cannot read {source}: {error}", "give a run folder or a CSV file"
        ) from None


def _table(source: Path) -> HandleLog:
    """Read a CSV file; columns of other names may hold anything."""
    rows = _rows(source)
    if (head := next(rows, None)) is None:
        raise ConfigError(f"{source} is empty", "give a CSV file with a header")
    names = [name.strip() for name in head]
    if not any(names):
        raise ConfigError(f"{source} starts with an empty line", "give a CSV file with a header")
    for column in (TIME, *HANDLES, *BENDS):
        if column not in names:
            near = get_close_matches(column, names, 1)
            hint = f"; is {near[0]} meant?" if near else f"; it has {', '.join(names)[:200]}"
            raise ConfigError(f"{source} has no column {column}{hint}")
    given = [name for name in TENSIONS if name in names]
    if given and len(given) < len(TENSIONS):
        raise ConfigError(f"{source} has {', '.join(given)}", "give all four tensions, or none")
    used = (TIME, *HANDLES, *BENDS, *given)
    for column in used:
        if names.count(column) > 1:
            raise ConfigError(f"{source} has column {column} more than once", "leave one of them")
    indices = [names.index(column) for column in used]
    numbers = []
    for line, row in enumerate(rows, 2):
        if not any(cell.strip() for cell in row):
            continue
        if any(cell.strip() for cell in row[len(names) :]):
            raise ConfigError(
                f"{source}, line {line}: {len(row)} values under {len(names)} columns",
                "separate the values by commas, and write numbers with a point",
            )
        cells = row + [""] * (len(names) - len(row))
        numbers.append([_number(source, line, names[n], cells[n]) for n in indices])
        if len(numbers) > MOST_ROWS:
            raise ConfigError(
                f"{source} has more than {MOST_ROWS} rows", "keep every tenth of them, or a part"
            )
    table = np.array(numbers).reshape(-1, len(used))
    return HandleLog(table[:, 0], table[:, 1:3], table[:, 3:5], table[:, 5:] if given else None)


def _number(source: Path, line: int, name: str, cell: str) -> float:
    try:
        value = float(cell)
        if np.isfinite(value):
            return value
    except ValueError:
        pass
    raise ConfigError(f"{source}, line {line}: {name} is {shown(cell)}", "use a finite number")


def _check(log: HandleLog) -> None:
    """Check that a log can be fitted; the messages do not name the file."""
    if len(log.t) < 2:
        raise ConfigError(f"{len(log.t)} rows", "record several periods of a slow triangle wave")
    steps = np.diff(log.t)
    if (back := int(steps.argmin())) >= 0 and steps[back] <= 0:
        raise ConfigError(
            f"time does not increase after t = {log.t[back]:g} s", "sort the rows by time"
        )
    longest = int(steps.argmax())
    if steps[longest] > max(GAP_S, 10 * float(np.median(steps))):
        raise ConfigError(
            f"a gap of {steps[longest]:.2f} s after t = {log.t[longest]:g} s",
            "record it again, or use the longer part",
        )
    _check_radians("handle angles", log.handle, LARGEST_HANDLE_RAD)
    _check_radians("tip bends", log.bend, LARGEST_BEND_RAD)
    if log.tension is not None and log.tension.max() > LARGEST_TENSION_N:
        raise ConfigError(
            f"tensions reach {log.tension.max():.4g} N, wanted 0 to {LARGEST_TENSION_N:g} N",
            "give them in newtons",
        )
    if log.tension is not None and log.tension.min() < -0.05 * np.ptp(log.tension):
        raise ConfigError("tensions are negative, but wires can only pull", "check sign and zero")
    if log.tension is not None and not log.tension[:, [log.axis, log.axis + 2]].max() > 0:
        raise ConfigError(
            f"the tensions of the {AXES[log.axis]} wires are all zero",
            "check the load cells, or leave the columns out",
        )
    handle, bend = log.handle[:, log.axis], log.bend[:, log.axis]
    for what, values, least in (
        ("handle", handle, LEAST_TRAVEL_RAD),
        ("tip", bend, LEAST_BEND_RAD),
    ):
        if np.ptp(values) < 2 * least:
            raise ConfigError(
                f"the {what} moves by {degrees(np.ptp(values)):.1f} deg from peak to peak",
                f"record strokes of at least {degrees(least):.0f} deg to either side",
            )
    alike = float(np.corrcoef(handle, bend)[0, 1])
    if alike < LEAST_CORRELATION:
        raise ConfigError(
            f"the {AXES[log.axis]} bend does not follow its handle (correlation {alike:.2f})",
            "check sign and axes",
        )
    turns = _turns(handle)
    if turns < LEAST_TURNS:
        raise ConfigError(
            f"the handle reverses {turns} times",
            f"record {LEAST_TURNS} reversals or more, such as two periods of a triangle wave",
        )


def _check_radians(what: str, values: Vector, largest: float) -> None:
    most = float(np.abs(values).max())
    if most > largest:
        raise ConfigError(
            f"{what} reach {most:.4g}, more than {largest:.1f} rad: these look like degrees",
            "divide them by 57.3",
        )


def _turns(handle: Vector) -> int:
    """Number of reversals of the handle after a stroke of `LEAST_TRAVEL_RAD` or more."""
    turns, direction, extreme = 0, 0, float(handle[0])
    for angle in handle[thin(handle, STEP_RAD)].tolist():
        if direction == 0 and abs(angle - extreme) >= LEAST_TRAVEL_RAD:
            direction, extreme = (1 if angle > extreme else -1), angle
        elif direction and (angle - extreme) * direction > 0:
            extreme = angle
        elif direction and (extreme - angle) * direction >= LEAST_TRAVEL_RAD:
            turns, direction, extreme = turns + 1, -direction, angle
    return turns
