"""Writes the packets on the serial line of a run as lines of text."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from struct import iter_unpack, unpack_from

from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.packets import BROADCAST, Instruction, Packet, Parser
from endolock.scripts.runs import folder_contents


def lines(folder: Path) -> Iterator[str]:
    """Yield one line for each packet: time, direction, content."""
    parsers = {False: Parser(), True: Parser()}
    for record in folder_contents.bus_records(folder):
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
    return f"{who} {name_of(packet.instruction)} {data.hex(' ')}"


def name_of(instruction: int) -> str:
    """Return the name of an instruction; of an unknown one its number."""
    known = instruction in list(Instruction)
    return Instruction(instruction).name.lower() if known else f"{instruction:#04x}"
