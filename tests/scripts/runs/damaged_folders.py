"""Damages copies of a run folder at random and reads them with every reader.

    python damaged_folders.py RUN SEED COUNT EVERY

prints each damage before it is read, so that a crash of the interpreter names it, and fails where a
changed value is not noticed. Every EVERY-th copy is also read by the commands.
"""

from __future__ import annotations

import contextlib
import io
import json
import random
import shutil
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

from endolock import ConfigError, DamageWarning, read_run
from endolock.scripts import cli
from endolock.scripts.runs import folder_contents

FILES = ("run.toml", "ticks.arrows", "frames.arrows", "metrics.json", "bus.log")
JSON = ["--json", "-"]
COMMANDS = (["view"], ["watch", *JSON], ["bus", *JSON], ["calibrate", *JSON])


def flip(data: bytearray, dice: random.Random) -> None:
    for _ in range(dice.choice((1, 1, 8))):
        data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)


def cut(data: bytearray, dice: random.Random) -> None:
    del data[dice.randrange(len(data)) :]


def lose(data: bytearray, dice: random.Random) -> None:
    start, size = block(data, dice)
    del data[start : start + size]


def insert(data: bytearray, dice: random.Random) -> None:
    start, size = block(data, dice)
    data[start:start] = dice.choice((dice.randbytes(size), bytes(size), b"\xff" * size))


def zero(data: bytearray, dice: random.Random) -> None:
    start, size = block(data, dice)
    data[start : start + size] = bytes(size)


def swap(data: bytearray, dice: random.Random) -> None:
    start, size = block(data, dice)
    other = dice.randrange(len(data))
    first, second = sorted((start, other))
    size = min(size, second - first, len(data) - second)
    a, b = data[first : first + size], data[second : second + size]
    data[first : first + size], data[second : second + size] = b, a


def double(data: bytearray, dice: random.Random) -> None:
    start, size = block(data, dice)
    data[start:start] = data[start : start + size]


def block(data: bytearray, dice: random.Random) -> tuple[int, int]:
    """Position and size of a part; sizes of all magnitudes, and those of disk sectors."""
    size = dice.choice((1, 4, 8, 100, 512, 4096, dice.randrange(1, len(data) + 1)))
    size = min(size, len(data))
    return dice.randrange(len(data) - size + 1), size


KINDS: tuple[Callable[[bytearray, random.Random], None], ...] = (
    flip,
    cut,
    lose,
    insert,
    zero,
    swap,
    double,
)


class Original:
    """What is in the folder before it is damaged."""

    def __init__(self, folder: Path) -> None:
        run = read_run(folder)
        assert run.damage == ()
        assert run.record is not None
        self.configuration, self.record = run.configuration, run.record.as_dict()
        self.rows = {
            "ticks": {row["t"]: repr(row) for row in run.ticks.to_pylist()},
            "frames": {row["seq"]: repr(row) for row in run.frames.to_pylist()},
        }
        self.bus = list(map(repr, folder_contents.bus_records(folder)))

    def compare(self, folder: Path, name: str) -> bool:
        """Read a folder whose file `name` was damaged; return whether anything is missing."""
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            try:
                run = read_run(folder)
                bus = list(map(repr, folder_contents.bus_records(folder)))
            except ConfigError as error:
                assert name == "run.toml" or not (folder / name).exists() or name == "bus.log"
                assert "\n" not in str(error)  # noqa: PT017
                return True
        noticed = [str(one.message) for one in said if one.category is DamageWarning]
        missing = False
        assert run.configuration == self.configuration
        for table, key in (("ticks", "t"), ("frames", "seq")):
            rows = getattr(run, table).to_pylist()
            assert [repr(row) for row in rows] == [self.rows[table][row[key]] for row in rows]
            assert sorted(row[key] for row in rows) == [row[key] for row in rows]
            missing |= len(rows) < len(self.rows[table])
        rest = iter(self.bus)
        assert all(record in rest for record in bus)  # in their order
        missing |= len(bus) < len(self.bus)
        assert run.record is None or run.record.as_dict() == self.record
        if run.record is None:
            missing |= (folder / "metrics.json").exists()
        if missing:
            assert any(name in text for text in noticed), "nothing was said"
        assert set(run.damage) <= set(noticed)
        return missing


def command(args: list[str], folder: Path) -> None:
    """Read a damaged folder with a command."""
    out, err = io.StringIO(), io.StringIO()
    more = ["--out", str(folder.parent / "camera.toml")] if args[0] == "calibrate" else []
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = cli.main([args[0], str(folder), *args[1:], *more])
    assert code in (0, 2), code
    lines = err.getvalue().splitlines()
    assert "Traceback" not in err.getvalue()
    errors = [line for line in lines if line.startswith("endolock: ") and "warning" not in line]
    assert len(errors) <= 1, errors
    if args[-1] == "-" and not errors:
        json.loads(out.getvalue())


def main(run: str, seed: str, count: str, every: str) -> None:
    """Damage copies and read them; print each damage, and at the end how many were noticed."""
    dice = random.Random(seed)
    original = Original(Path(run))
    noticed = 0
    for n in range(int(count)):
        with tempfile.TemporaryDirectory() as parent:
            folder = Path(parent) / "run"
            shutil.copytree(run, folder)
            name = dice.choice(FILES)
            kind = dice.choice(KINDS)
            data = bytearray((folder / name).read_bytes())
            removed = dice.random() < 0.03
            print(n, "remove" if removed else kind.__name__, name, flush=True)
            if removed:
                (folder / name).unlink()
            else:
                kind(data, dice)
                (folder / name).write_bytes(data)
            noticed += original.compare(folder, name)
            if n % int(every) == 0:
                for args in COMMANDS:
                    command(args, folder)
    print("noticed", noticed)


if __name__ == "__main__":
    main(*sys.argv[1:])
