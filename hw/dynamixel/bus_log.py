"""The raw log of a bus: every byte sent or received, with its time, append-only.

A file is the eight bytes `BUSLOG-2` and then records of

    `BUS>` | CRC-32 of the rest, uint32 | number from 0, uint32 | time [s], float64
           | direction, uint8: 0 out, 1 in | count, uint16 | the bytes                little-endian

Each record is passed to the system in one write, so after a kill the file is readable up to the
last complete one; where bytes were changed, inserted or lost, the records around them are still
found. Nothing is interpreted here; a log can be decoded, and replayed through the same bus and
drive that wrote it. Earlier versions wrote `ENDOBUS1`, with time, direction, count and bytes alone.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from errno import ENOSPC
from pathlib import Path
from struct import Struct
from typing import NamedTuple
from zlib import crc32

from endolock.hw.api import ConfigError

MAGIC = b"BUSLOG-2"
_UNSEALED = b"ENDOBUS1"
_MARK = b"BUS>"
_SUM = Struct("<4sI")
_HEAD = Struct("<IdBH")
_OLD_HEAD = Struct("<dBH")


class Chunk(NamedTuple):
    """Bytes sent or received together."""

    t: float
    """Clock time [s]."""
    came_in: bool
    data: bytes


class BusLog:
    """Writes a log.

    Args:
        path: a new file.

    Raises:
        ConfigError: it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._records = 0
        try:
            self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
        except OSError as error:
            raise ConfigError(
                f"cannot write {path}: {error.strerror}", "give another folder"
            ) from None
        self._write(MAGIC)

    def append(self, t: float, came_in: bool, data: bytes) -> None:
        """Append bytes sent or received; at most 65535.

        Raises:
            ConfigError: the disk is full or was removed.
        """
        rest = _HEAD.pack(self._records, t, came_in, len(data)) + data
        self._write(_SUM.pack(_MARK, crc32(rest)) + rest)
        self._records += 1

    def close(self) -> None:
        """Close the file; may be called twice."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def _write(self, record: bytes) -> None:
        try:
            if os.write(self._fd, record) < len(record):
                raise OSError(ENOSPC, os.strerror(ENOSPC))
        except OSError as error:
            raise ConfigError(
                f"cannot write {self._path}: {error.strerror}", "make room, or give another folder"
            ) from None


def read(path: Path) -> Iterator[Chunk]:
    """Yield the whole records of a log, in their order.

    Raises:
        ConfigError: the file cannot be read, or is not a bus log.
    """
    yield from records(path).values()


def records(path: Path) -> dict[int, Chunk]:
    """Return the whole records of a log by number, in their order.

    Raises:
        ConfigError: the file cannot be read, or is not a bus log.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(
            f"cannot read {path}: {error.strerror}", "give a run on an emulated or real bus"
        ) from None
    if data.startswith(_UNSEALED):
        return dict(enumerate(_old_records(data)))
    found: dict[int, Chunk] = {}
    at = data.find(_MARK)
    if at < 0 and data[: len(MAGIC)] != MAGIC[: len(data)]:
        raise ConfigError(f"{path} is not a bus log", "give the bus.log of a run folder")
    while at >= 0:
        start = at + _SUM.size
        end = start + _HEAD.size
        if end <= len(data):
            number, t, came_in, size = _HEAD.unpack_from(data, start)
            end += size
            if end <= len(data) and crc32(data[start:end]) == _SUM.unpack_from(data, at)[1]:
                found[number] = Chunk(t, bool(came_in), data[end - size : end])
                at = data.find(_MARK, end)
                continue
        at = data.find(_MARK, at + 1)
    return dict(sorted(found.items()))


def crc_of(found: Mapping[int, Chunk]) -> int:
    """Return the check sum of all records of a log; it tells runs apart."""
    crc = 0
    for number, chunk in found.items():
        head = _HEAD.pack(number, chunk.t, chunk.came_in, len(chunk.data))
        crc = crc32(head + chunk.data, crc)
    return crc


def damage(found: Iterable[int], stated: int | None) -> list[str]:
    """Describe what is missing in a log.

    Args:
        found: numbers of its whole records.
        stated: the number of records it should have; None if that is unknown.
    """
    said, next_one, whole = [], 0, 0
    for number in found:
        if number > next_one:
            said.append(f"records {next_one} to {number - 1} are damaged")
        next_one, whole = number + 1, whole + 1
    if stated is not None and next_one < stated:
        said.append(f"ends early: {whole} of {stated} records")
    return said


def _old_records(data: bytes) -> Iterator[Chunk]:
    """Yield the records of a log without check sums, up to its last complete one."""
    at = len(_UNSEALED)
    while at + _OLD_HEAD.size <= len(data):
        t, came_in, size = _OLD_HEAD.unpack_from(data, at)
        at += _OLD_HEAD.size
        if at + size > len(data):
            return
        yield Chunk(t, bool(came_in), data[at : at + size])
        at += size


class Exchange(NamedTuple):
    """One request, and all that was received until the next one."""

    t: float
    """When it was sent [s]."""
    request: bytes
    answers: tuple[Chunk, ...]


def exchanges(records: Iterable[Chunk]) -> Iterator[Exchange]:
    """Group records by requests; what was received before the first one is left out."""
    out: Chunk | None = None
    answers: list[Chunk] = []
    for record in records:
        if record.came_in:
            answers.append(record)
            continue
        if out is not None:
            yield Exchange(out.t, out.data, tuple(answers))
        out, answers = record, []
    if out is not None:
        yield Exchange(out.t, out.data, tuple(answers))


class ReplayPort:
    """A port that answers as a log says; see `port.Port`. It is also the clock of the replay.

    Args:
        exchanges: those of the log.
    """

    name = "replay"
    realtime = False
    timestep_s = 0.0

    def __init__(self, exchanges: Sequence[Exchange]) -> None:
        self._exchanges = exchanges
        self._coming: list[Chunk] = []
        self._now = 0.0
        self.index = 0
        """Index of the exchange that the next request should equal."""
        self.same = True
        """Whether all that was sent equals the log."""

    def seek(self, index: int) -> None:
        """Go to an exchange, and to its time."""
        self.index, self._now = index, self._exchanges[index].t

    def now(self) -> float:
        """Time in the log [s]: that of the next request until it is sent."""
        return self._now

    def sleep_until(self, t: float) -> float:
        """Return the time; only the log advances it."""
        return self._now

    def open(self) -> None:
        """Nothing to do."""

    def set_baud(self, baud: int) -> None:
        """Nothing to do."""

    def send(self, data: bytes) -> None:
        """Compare with the logged request; its answers can then be received."""
        if self.index >= len(self._exchanges):
            self._coming = []  # the log ends here
            return
        exchange = self._exchanges[self.index]
        self.index += 1
        self.same = self.same and data == exchange.request
        self._coming, self._now = list(exchange.answers), exchange.t

    def receive(self, timeout_s: float) -> bytes:
        """Return what was received then."""
        if not self._coming:
            return b""
        record = self._coming.pop(0)
        self._now = record.t
        return record.data

    def close(self) -> None:
        """Nothing to do."""
