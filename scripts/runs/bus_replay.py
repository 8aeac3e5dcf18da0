"""Replays a run from the bytes on its serial line, through the drivers that wrote them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from struct import iter_unpack, pack
from typing import Any

from pydantic import TypeAdapter

from endolock.hw.api import AXES, ConfigError, DeviceFault, HardwareError
from endolock.hw.drive import Reading
from endolock.hw.dynamixel import bus_log
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.bus_log import Exchange, ReplayPort
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.packets import Instruction, Packet, Parser
from endolock.hw.dynamixel.registers import Units
from endolock.hw.dynamixel.servo_bus import Bus
from endolock.hw.dynamixel.servo_drive import ServoDrive
from endolock.scripts.runs import folder_contents, packet_lines

_ENABLING = pack("<H", reg.INDIRECT_ADDRESS.address)
"""First request of enabling: whether a motor has restarted."""
_DISABLING = pack("<H", reg.TORQUE_ENABLE.address) + b"\x00"


@dataclass(frozen=True, kw_only=True)
class BusReplay:
    """A replayed run, as the JSON of `endolock bus` holds it."""

    exchanges: int
    """Number of requests, each with its answer."""
    duration_s: float
    """From the first logged bytes to the last [s]."""
    packets: dict[str, int]
    """Number of packets by instruction."""
    damaged: int
    """Number of packets with a wrong checksum or length."""
    unanswered: int
    """Number of cycles in which not every motor answered."""
    cycles: int
    """Number of cycles: goals out, measurements in."""
    requests_equal: bool
    """Whether the drivers sent the logged bytes again."""
    ticks: int
    """Number of control ticks in the run folder."""
    positions_equal: int
    """Number of these whose time and position the replay gave again."""
    damage: list[str]
    """What is missing or damaged in the run folder; the rest is replayed."""


def replay(folder: Path) -> BusReplay:
    """Decode and replay the log of a run.

    Args:
        folder: run folder of a run with --rig hil or serial:PORT.

    Raises:
        ConfigError: the folder has no log of a line.
    """
    records = folder_contents.bus_records(folder)
    exchanges = list(bus_log.exchanges(records))
    kinds: Counter[str] = Counter()
    parsers = {False: Parser(), True: Parser()}
    for record in records:
        for packet in parsers[record.came_in].feed(record.data):
            kinds[packet_lines.name_of(packet.instruction)] += 1
    port = ReplayPort(exchanges)
    readings = list(_replay(port, exchanges, folder_contents.configuration(folder)))
    ticks = folder_contents.read(folder, "ticks")
    logged = zip(ticks["state_t"].to_pylist(), ticks["position_rad"].to_pylist(), strict=True)
    # The line also has the readings while enabling, and those after the last row.
    replayed = {(reading.t, reading.position) for reading in readings}
    equal = sum((t, tuple(position)) in replayed for t, position in logged)
    return BusReplay(
        exchanges=len(exchanges),
        duration_s=records[-1].t - records[0].t if records else 0.0,
        packets=dict(kinds),
        damaged=sum(parser.damaged for parser in parsers.values()),
        unanswered=sum(not r.fresh for r in readings),
        cycles=len(readings),
        requests_equal=port.same,
        ticks=ticks.num_rows,
        positions_equal=equal,
        damage=folder_contents.damage(folder, "ticks", "bus"),
    )


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
    stopped = False  # by a fault, after which the guard only measures and holds
    while port.index < len(exchanges):
        request = Parser().feed(exchanges[port.index].request)
        kind, data = request[-1].instruction, request[-1].parameters
        here = port.index
        port.seek(here)
        try:
            if kind == Instruction.SYNC_READ:
                goals = _goals(request, drive, tuple(names))
                sent = tuple(goal for goal in goals if goal is not None)
                if sent and (stopped or len(sent) < len(goals)):
                    drive.hold(goals)
                elif stopped:
                    yield drive.measure()
                else:
                    yield drive.transfer(sent or None)
            elif kind == Instruction.READ and data.startswith(_ENABLING):
                drive.torque(True)
            elif kind == Instruction.WRITE and data.startswith(_DISABLING):
                stopped = False
                drive.torque(False)
        except DeviceFault:
            stopped = True
        except HardwareError:
            pass  # raised in the run, too, or what comes before is missing in a damaged log
        port.index = max(port.index, here + 1)  # one of the set-up has not been replayed


def _goals(
    request: list[Packet], drive: ServoDrive, devices: tuple[int, ...]
) -> tuple[float | None, ...]:
    """Return the goal of each motor in a request [rad]; None for one without a goal."""
    data = request[0].parameters[4:] if len(request) > 1 else b""
    sent = dict(iter_unpack("<Bi", data))
    angles = drive.angles([sent.get(device, 0) for device in devices])
    return tuple(a if d in sent else None for a, d in zip(angles, devices, strict=True))
