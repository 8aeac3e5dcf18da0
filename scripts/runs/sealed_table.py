"""Tables that grow by groups of rows, each sealed with a check sum.

A file is an Arrow IPC stream, which every Arrow reader can read. Each of its messages, the schema
first and then one per group of rows, contains its seal as metadata:

    endolock-seal CRC GROUP FIRST ROWS OFFSET LENGTH      ASCII, of constant length

CRC is the CRC-32 of the whole message with eight zeros in its place, OFFSET that of the seal in
the message, LENGTH that of the message [bytes]. Groups count from 1, rows from 0; the schema is
group 0. A reader finds messages by their seals, so bytes that were changed, moved, inserted or
lost cost only the groups that they hit, and damaged bytes never get to Arrow.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
from collections.abc import Iterator, Mapping
from errno import ENOSPC
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple
from zlib import crc32

import pyarrow as pa

from endolock.hw.api import ConfigError
from endolock.hw.lifecycle import Closing

MARK = b"endolock-seal "
"""How a seal begins."""
_SEAL = re.compile(MARK + rb"([0-9a-f]{8}) (\d{8}) (\d{12}) (\d{6}) (\d{6}) (\d{12})")
_BLANK = MARK + b"00000000 00000000 000000000000 000000 000000 000000000000"
_END = b"\xff\xff\xff\xff\x00\x00\x00\x00"
"""End of an Arrow stream."""
_WINDOW = 1 << 16
"""Bytes that are searched for a seal at a time."""


class Group(NamedTuple):
    """Position of a whole group of rows in its file."""

    number: int
    """Number of the group, from 1; 0 for the schema."""
    first: int
    """Number of its first row, from 0."""
    rows: int
    start: int
    """Position of its message in the file [bytes]."""
    length: int
    """Length of its message [bytes]."""
    crc: int
    """CRC-32 of its message, with its seal."""


class TableWriter(Closing):
    """Writes a table; each group of rows goes to the system in one write.

    Args:
        path: a new file.
        schema: columns of the table.
        group: number of rows that are written together, unless `flush` is called.
    """

    def __init__(self, path: Path, schema: pa.Schema, group: int) -> None:
        self._path, self._schema, self._group = path, schema, group
        self._file = path.open("xb", buffering=0)
        self._rows: list[Mapping[str, Any]] = []
        self._groups = 0
        self.rows = 0
        """Number of rows written."""
        self.crc = 0
        """Check sum of all rows written; see `crc_of`."""
        self._buffer = io.BytesIO()
        self._stream = pa.ipc.new_stream(self._buffer, schema)
        self._message(pa.RecordBatch.from_pylist([], schema))  # the schema goes with the first one
        sealed = schema.with_metadata({"seal": _BLANK})
        self._write(_sealed(sealed.serialize().to_pybytes(), 0, 0, 0, 0))

    def append(self, row: Mapping[str, Any]) -> None:
        """Append a row.

        Raises:
            ConfigError: it cannot be written.
        """
        self._rows.append(row)
        if len(self._rows) >= self._group:
            self.flush()

    def flush(self) -> None:
        """Write the rows of an incomplete group.

        Raises:
            ConfigError: they cannot be written.
        """
        rows, self._rows = self._rows, []
        if not rows:
            return
        self._groups += 1
        message = self._message(pa.RecordBatch.from_pylist(rows, self._schema))
        message = _sealed(message, _seed(self._schema), self._groups, self.rows, len(rows))
        self._write(message)
        self.rows += len(rows)
        self.crc = _chained(self.crc, crc32(message))

    def close(self) -> None:
        """Write the last rows and the end mark; may be called twice."""
        if self._file.closed:
            return
        try:
            self.flush()
            with contextlib.suppress(ConfigError):  # the end mark is of no use to us
                self._write(_END)
        finally:
            self._file.close()

    def _message(self, batch: pa.RecordBatch) -> bytes:
        """Return a batch as a message of a stream, with an empty seal."""
        self._buffer.seek(0)
        self._buffer.truncate()
        self._stream.write_batch(batch, custom_metadata={"seal": _BLANK})
        return self._buffer.getvalue()

    def _write(self, data: bytes) -> None:
        try:
            if (self._file.write(data) or 0) < len(data):
                raise OSError(ENOSPC, os.strerror(ENOSPC))
        except OSError as error:
            raise ConfigError(
                f"cannot write {self._path}: {error.strerror or error}",
                "make room, or give another folder",
            ) from error


def groups(file: BinaryIO, schema: pa.Schema) -> list[Group]:
    """Find the whole groups of a table, in the order of their rows, each once.

    The schema is among them, as group 0, where it is whole.
    """
    found = {group.number: group for group, _ in _whole(file, _seed(schema))}
    return [found[number] for number in sorted(found)]


def schema_of(file: BinaryIO, schema: Group) -> pa.Schema:
    """Read the schema of a table from its group."""
    return pa.ipc.read_schema(pa.py_buffer(_read(file, schema.start, schema.length)))


def batch_of(file: BinaryIO, group: Group, schema: pa.Schema) -> pa.RecordBatch:
    """Read the rows of a whole group."""
    data = _read(file, group.start, group.length)
    return pa.ipc.read_record_batch(pa.py_buffer(data), schema)


def crc_of(found: list[Group]) -> int:
    """Return the check sum of all rows of a table, from its groups; it tells runs apart."""
    crc = 0
    for group in found:
        crc = _chained(crc, group.crc) if group.number else crc
    return crc


def is_sealed(file: BinaryIO) -> bool:
    """Whether there is a seal in a file, whole or not."""
    return _find(file, re.compile(re.escape(MARK)), 0) is not None


def damage(found: list[Group], stated: int | None) -> list[str]:
    """Describe what is missing in a table.

    Args:
        found: its whole groups.
        stated: the number of rows it should have; None if that is unknown.
    """
    said, number, row, whole = [], 1, 0, 0
    for group in found:
        if not group.number:
            continue
        if group.number > number:
            last = group.number - 1
            one = last == number
            which = f"row group {number} is" if one else f"row groups {number} to {last} are"
            said.append(f"{which} damaged: rows {row} to {group.first - 1} are missing")
        number, row = group.number + 1, group.first + group.rows
        whole += group.rows
    if stated is not None and row < stated:
        said.append(f"ends early: {whole} of {stated} rows")
    return said


def _whole(file: BinaryIO, seed: int) -> Iterator[tuple[Group, bytes]]:
    """Yield the messages with a correct check sum, in the order of the file."""
    size = file.seek(0, os.SEEK_END)
    position = 0
    while hit := _find(file, _SEAL, position):
        at, match = hit
        number, first, rows, offset, length = (int(part) for part in match.groups()[1:])
        start = at - offset
        position = at + 1
        if start < 0 or length < offset + len(_BLANK) or start + length > size:
            continue
        data = _read(file, start, length)
        crc = offset + len(MARK)
        blank = data[:crc] + b"00000000" + data[crc + 8 :]
        if crc32(blank, seed if number else 0) == int(match[1], 16):
            yield Group(number, first, rows, start, length, crc32(data)), data
            position = start + length


def _find(
    file: BinaryIO, pattern: re.Pattern[bytes], position: int
) -> tuple[int, re.Match[bytes]] | None:
    """Find a pattern from a position on; return where it is, and the match."""
    while window := _read(file, position, _WINDOW):
        if match := pattern.search(window):
            return position + match.start(), match
        if len(window) < _WINDOW:
            return None
        position += _WINDOW - len(_BLANK)
    return None


def _read(file: BinaryIO, start: int, length: int) -> bytes:
    file.seek(start)
    return file.read(length)


def _chained(crc: int, of_group: int) -> int:
    return crc32(of_group.to_bytes(4, "little"), crc)


def _sealed(message: bytes, seed: int, number: int, first: int, rows: int) -> bytes:
    """Fill the empty seal of a message."""
    at = message.index(_BLANK)
    facts = b" %08d %012d %06d %06d %012d" % (number, first, rows, at, len(message))
    parts = message[: at + len(MARK)], facts, message[at + len(_BLANK) :]
    crc = crc32(parts[0] + b"00000000" + facts + parts[2], seed)
    return parts[0] + b"%08x" % crc + facts + parts[2]


def _seed(schema: pa.Schema) -> int:
    """Return the start of the check sums of a table: a group fits only columns of these names."""
    return crc32(",".join(schema.names).encode())
