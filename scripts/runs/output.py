"""The JSON of a command, written to a file or to standard output."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from endolock.hw import files
from endolock.hw.api import ConfigError


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
        sys.stdout.write(text)
        return
    files.write_whole(Path(target), text, "use another --json")
