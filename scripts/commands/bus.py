"""`endolock bus`: decode the bytes on the line in a run, and replay the run from them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from struct import iter_unpack, pack, unpack_from
from typing import Annotated, Any

import tyro
from pydantic import TypeAdapter
from rich.console import Console

from endolock.hw.api import AXES, ConfigError, DeviceFault, HardwareError
from endolock.hw.drive import Reading
from endolock.hw.dynamixel import bus_log
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.bus_log import Exchange, ReplayPort
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.packets import BROADCAST, Instruction, Packet, Parser
from endolock.hw.dynamixel.registers import Units
from endolock.hw.dynamixel.servo_bus import Bus
from endolock.hw.dynamixel.servo_drive import ServoDrive
from endolock.scripts.runs import output, run_folder


@dataclass(frozen=True, kw_only=True)
class Request:
    """Decode the raw log of the serial line in a run folder, and replay it through the drivers."""

    run: tyro.conf.Positional[Path]
    """Run folder of a run with --rig hil or serial."""
    packets: bool = False
    """Print every packet as well."""
    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write the result there as JSON; - prints it, and nothing else, on standard output."""


def main(request: Request) -> int:
    """Carry out `endolock bus`; return the exit code: 2 where the replay sends different bytes."""
    output.check_json(request.json)
    console = Console(highlight=False)
    if request.packets and request.json != "-":
        for line in lines(request.run):
            console.print(line, soft_wrap=True, markup=False)
    record = perform(request.run)
    output.write_json(record, request.json)
    if request.json != "-":
        counts = ", ".join(f"{n} {name}" for name, n in record["packets"].items())
        text = f"{record['exchanges']} exchanges in {record['duration_s']:.2f} s: {counts}"
        console.print(text, soft_wrap=True)
        console.print(
            f"{record['damaged']} packets damaged, {record['unanswered']} cycles not fully answered"
        )
        same = "the same" if record["requests_equal"] else "NOT the same"
        console.print(
            f"replayed: {record['cycles']} cycles; requests {same} byte for byte; "
            f"{record['positions_equal']} of {record['ticks']} ticks have the logged position",
            soft_wrap=True,
        )
    return 0 if record["requests_equal"] else 2


def perform(folder: Path) -> dict[str, Any]:
    """Decode and replay the log of a run.

    Raises:
        ConfigError: the folder has no log of a line.
    """
    records = list(bus_log.read(folder / run_folder.BUS_LOG))
    exchanges = list(bus_log.exchanges(records))
    kinds: Counter[str] = Counter()
    parsers = {False: Parser(), True: Parser()}
    for record in records:
        for packet in parsers[record.came_in].feed(record.data):
            kinds[_name(packet.instruction)] += 1
    port = ReplayPort(exchanges)
    readings = list(_replay(port, exchanges, run_folder.configuration(folder)))
    ticks = run_folder.read(folder, "ticks")
    logged = zip(ticks["state_t"].to_pylist(), ticks["position_rad"].to_pylist(), strict=True)
    # The line also has the readings while enabling, and those after the last row.
    replayed = {(reading.t, reading.position) for reading in readings}
    equal = sum((t, tuple(position)) in replayed for t, position in logged)
    return {
        "exchanges": len(exchanges),
        "duration_s": records[-1].t - records[0].t if records else 0.0,
        "packets": dict(kinds),
        "damaged": sum(parser.damaged for parser in parsers.values()),
        "unanswered": sum(not r.fresh for r in readings),
        "cycles": len(readings),
        "requests_equal": port.same,
        "ticks": ticks.num_rows,
        "positions_equal": equal,
    }


def _replay(
    port: ReplayPort, exchanges: list[Exchange], configuration: dict[str, Any]
) -> Iterator[Reading]:
    """Replay a log through the drivers that wrote it; yield the reading of each cycle."""
    try:
        line = configuration["line"]
        handles = {axis: Handle.model_validate(line["handle"][axis]) for axis in AXES}
        units = TypeAdapter(Units).validate_python(line["units"])
    except (KeyError, ValueError) as error:
        raise ConfigError(
            f"run.toml does not describe a line ({error})",
            "give a run with --rig hil or serial:PORT",
        ) from None
    names = {handle.id: axis for axis, handle in handles.items()}
    drive = ServoDrive(Bus(port, port, names), port, handles, units)
    while port.index < len(exchanges):
        request = Parser().feed(exchanges[port.index].request)
        kind, data = request[-1].instruction, request[-1].parameters
        port.seek(port.index)
        try:
            if kind == Instruction.SYNC_READ:
                yield drive.transfer(_goals(request, drive))
            elif kind == Instruction.READ and data.startswith(_ENABLING):
                drive.torque(True)
            elif kind == Instruction.WRITE and data.startswith(_DISABLING):
                drive.torque(False)
            else:
                port.index += 1  # of the set-up
        except DeviceFault:
            drive.hold()  # as the guard did
        except HardwareError:
            continue  # raised in the run, too


_ENABLING = pack("<H", reg.INDIRECT_ADDRESS.address)
"""First request of enabling: whether a motor has restarted."""
_DISABLING = pack("<H", reg.TORQUE_ENABLE.address) + b"\x00"


def _goals(request: list[Packet], drive: ServoDrive) -> tuple[float, ...] | None:
    if len(request) == 1:
        return None
    return drive.angles([goal for _, goal in iter_unpack("<Bi", request[0].parameters[4:])])


def lines(folder: Path) -> Iterator[str]:
    """Yield one line for each packet: time, direction, content."""
    parsers = {False: Parser(), True: Parser()}
    for record in bus_log.read(folder / run_folder.BUS_LOG):
        for packet in parsers[record.came_in].feed(record.data):
            arrow = "<" if record.came_in else ">"
            yield f"{record.t:10.6f} {arrow} {_text(packet)}"


def _text(packet: Packet) -> str:
    who = "all" if packet.id == BROADCAST else f"{packet.id:3d}"
    data = packet.parameters
    if packet.instruction == Instruction.STATUS and len(data) == 1 + reg.BLOCK_SIZE:
        block = reg.unpack(data[1:])
        values = ", ".join(f"{k} {v}" for k, v in block._asdict().items())
        return f"{who} block, error {data[0]:#04x}: {values}"
    if packet.instruction == Instruction.SYNC_WRITE and len(data) >= 4:
        address, size = unpack_from("<HH", data)
        if (address, size) == reg.GOAL_POSITION and not (len(data) - 4) % 5:
            goals = ", ".join(f"{i}: {goal}" for i, goal in iter_unpack("<Bi", data[4:]))
            return f"{who} goals {goals}"
    return f"{who} {_name(packet.instruction)} {data.hex(' ')}"


def _name(instruction: int) -> str:
    known = instruction in list(Instruction)
    return Instruction(instruction).name.lower() if known else f"{instruction:#04x}"
