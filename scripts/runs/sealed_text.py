"""Check sums inside the text files of a run folder, run.toml and metrics.json.

The sum is the CRC-32 of the text with eight zeros in its place:

    # crc32 1a2b3c4d of this file ... # end of the run's configuration    TOML, first, last line
    {"crc32": "1a2b3c4d", ..., "rows": {...}}                             JSON, first, last key

metrics.json also contains the sums of run.toml and of all rows of each table, as `sums`: a file
that was exchanged with that of another run is whole, but has another sum.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any
from zlib import crc32

import tomli_w

_ZEROS = "00000000"
_FIRST = "# crc32 {} of this file with zeros in its place\n"
_LAST = "# end of the run's configuration\n"
_SUM = re.compile(rb'crc32"?:? "?([0-9a-f]{8})')


def toml(values: Mapping[str, Any]) -> bytes:
    """Return values as sealed TOML."""
    return _filled(_FIRST.format(_ZEROS) + tomli_w.dumps(values) + _LAST)


def json_(values: Mapping[str, Any], rows: Mapping[str, int]) -> bytes:
    """Return values as sealed JSON, with the numbers of rows as the last of them."""
    whole = {"crc32": _ZEROS, **values, "rows": rows}
    return _filled(json.dumps(whole, indent=2, allow_nan=False) + "\n")


def is_whole(data: bytes) -> bool:
    """Whether a file is as it was written; a file that was never sealed counts as whole."""
    found = _SUM.search(data[:100])
    if found is None:
        return _LAST.encode() not in data and b'"rows": {' not in data
    blank = data[: found.start(1)] + _ZEROS.encode() + data[found.end(1) :]
    return crc32(blank) == int(found[1], 16)


def is_sealed(data: bytes) -> bool:
    """Whether a file has a check sum."""
    return sum_in(data) is not None


def sum_in(data: bytes) -> str | None:
    """Return the check sum that a file contains; None if it has none."""
    found = _SUM.search(data[:100])
    return found[1].decode() if found else None


def _filled(text: str) -> bytes:
    data = text.encode()
    return data.replace(_ZEROS.encode(), b"%08x" % crc32(data), 1)
