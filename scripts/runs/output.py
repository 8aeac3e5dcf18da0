"""What a command says: its notes, and its JSON in a file or on standard output."""

from __future__ import annotations

import ctypes
import json
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TextIO

from endolock.hw import files
from endolock.hw.api import ConfigError

_json: ContextVar[TextIO | None] = ContextVar("_json", default=None)
"""Where `write_json` writes while standard output is kept for it; None for standard output."""


@contextmanager
def json_alone() -> Iterator[None]:
    """Keep standard output for `write_json`: all else that is written to it goes to standard error.

    This includes what a library in C or a child process writes to file descriptor 1.

    Raises:
        ConfigError: standard output is closed.
    """
    before = sys.stdout
    if before is None or before.closed:
        raise ConfigError("standard output is closed", "give --json a file")
    before.flush()
    kept = os.dup(1)
    direct = before is sys.__stdout__  # otherwise it is captured, such as by a test
    stream = os.fdopen(os.dup(1), "w", encoding="utf-8") if direct else before
    os.dup2(2, 1)
    sys.stdout = sys.stderr
    token = _json.set(stream)
    try:
        yield
        if direct:
            stream.close()
    finally:
        _json.reset(token)
        with suppress(OSError, ValueError):
            before.flush()  # what was written to sys.__stdout__ meanwhile
        with suppress(OSError, AttributeError, TypeError):
            ctypes.CDLL(None).fflush(None)  # and by C code
        os.dup2(kept, 1)
        os.close(kept)
        sys.stdout = before


def check_json(target: str | None) -> None:
    """Check that the JSON can be written later.

    Raises:
        ConfigError: its folder does not exist, or it names a folder.
    """
    if target in (None, "-"):
        return
    path = Path(str(target))
    if path.is_dir() or not path.parent.is_dir():
        raise ConfigError(f"cannot write {path}", "give --json a file in an existing folder, or -")


def write_json(record: Mapping[str, Any], target: str | None) -> None:
    """Write a record to a file, or to standard output for "-".

    Raises:
        ConfigError: the file cannot be written.
    """
    if target is None:
        return
    text = json.dumps(record, indent=2, allow_nan=False) + "\n"
    if target == "-":
        (_json.get() or sys.stdout).write(text)
        return
    files.write_whole(Path(target), text, "use another --json")


def say(notes: Iterable[str]) -> None:
    """Print notes on standard error, each once, in one line."""
    for note in dict.fromkeys(notes):
        print(f"endolock: note: {' '.join(note.split())}", file=sys.stderr)
