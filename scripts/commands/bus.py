"""`endolock bus`: decode the bytes on the line in a run, and replay the run from them."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from endolock.scripts.runs import bus_replay, output, packet_lines


@dataclass(frozen=True, kw_only=True)
class Request:
    """Decode the raw log of the serial line in a run folder, and replay it through the drivers."""

    run: tyro.conf.Positional[Path]
    """Run folder of a run with --rig hil or serial."""
    packets: bool = False
    """Print every packet as well."""
    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write the result to this file as JSON; - prints only the JSON on standard output."""


def main(request: Request) -> int:
    """Carry out `endolock bus`; return the exit code: 2 where the replay sends different bytes."""
    output.check_json(request.json)
    console = Console(highlight=False)
    if request.packets and request.json != "-":
        for line in packet_lines.lines(request.run):
            console.print(line, soft_wrap=True, markup=False)
    record = bus_replay.replay(request.run)
    output.write_json(asdict(record), request.json)
    if request.json != "-":
        counts = ", ".join(f"{n} {name}" for name, n in record.packets.items())
        text = f"{record.exchanges} exchanges in {record.duration_s:.2f} s: {counts}"
        console.print(text, soft_wrap=True)
        console.print(
            f"{record.damaged} packets damaged, {record.unanswered} cycles not fully answered"
        )
        same = "the same" if record.requests_equal else "NOT the same"
        console.print(
            f"replayed: {record.cycles} cycles; requests {same} byte for byte; "
            f"{record.positions_equal} of {record.ticks} ticks have the logged position",
            soft_wrap=True,
        )
    return 0 if record.requests_equal else 2
