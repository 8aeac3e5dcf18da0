"""hw/PROTOCOL.md says what is asked of the motors, and shows every byte of a cycle as it is."""

from __future__ import annotations

import re
from pathlib import Path
from struct import unpack
from typing import NamedTuple

import pytest
from tests.hw.emulated import BenchClock

from endolock.hw.api import AXES
from endolock.hw.dynamixel import bus_log
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.models import XM430_W350
from endolock.hw.dynamixel.packets import Instruction, Packet, Parser, Refusal
from endolock.hw.dynamixel.servo_bus import Bus
from endolock.hw.dynamixel.servo_drive import ServoDrive
from endolock.hw.dynamixel.settings import SETTINGS, Wish
from endolock.hw.emulator.emulated_bus import EmulatedBus
from endolock.hw.emulator.loopback import Loopback
from endolock.hw.emulator.servo_model import Servo

LIMITED = 2
"""Id of the motor whose handle has a current limit."""
PAGE = (Path(__file__).parents[3] / "hw" / "PROTOCOL.md").read_text()


class Still:
    """A motor with given measurements."""

    measured = (0.0, 0.0, 0.0)

    def measure(self) -> tuple[float, float, float]:
        """Return it."""
        return self.measured

    def aim(self, angle_rad: float) -> None:
        """Stay there."""

    def power(self, on: bool) -> None:
        """Stay there."""


class Talk(NamedTuple):
    """What went over the line, by what it was for."""

    connect: list[bus_log.Chunk]
    enable: list[bus_log.Chunk]
    cycle: list[bus_log.Chunk]
    leave: list[bus_log.Chunk]


@pytest.fixture(scope="module")
def talk(tmp_path_factory: pytest.TempPathFactory) -> Talk:
    """Connect two new motors, the second with a current limit; enable; one cycle; leave."""
    clock, motors = BenchClock(), (Still(), Still())
    servos = [Servo(motor, device=n, now=clock.now) for n, motor in enumerate(motors, 1)]
    bus = Bus(Loopback(EmulatedBus(servos, clock.now)), clock, dict(enumerate(AXES, 1)))
    limits = (None, 1.0)
    handles = {
        axis: Handle(id=n, zero_counts=2048, current_limit_a=limit)
        for n, (axis, limit) in enumerate(zip(AXES, limits, strict=True), 1)
    }
    drive = ServoDrive(bus, clock, handles)
    path = tmp_path_factory.mktemp("page") / "bus.log"
    bus.record(path)
    units, step, seen = reg.Units(), reg.Units().position_rad, 0

    def said() -> list[bus_log.Chunk]:
        nonlocal seen
        records = list(bus_log.read(path))
        new, seen = records[seen:], len(records)
        return new

    drive.open()
    connect = said()
    drive.transfer((0.0, 0.0))
    said()
    drive.torque(True)
    enable = said()
    clock.sleep_until(0.25)
    for motor, counts, speed, current in zip(motors, (52, -30), (13, -7), (-5, 4), strict=True):
        motor.measured = (counts * step, speed * units.velocity_rad_s, current * units.current_a)
    drive.transfer((62 * step, -40 * step))
    cycle = said()
    drive.torque(False)
    leave = said()
    bus.close()
    return Talk(connect, enable, cycle, leave)


def rows(heading: str) -> list[dict[str, str]]:
    """Return the table under a heading of the page, each row by its columns' names."""
    part = re.split(rf"^#+ {heading}$", PAGE, flags=re.MULTILINE)[1]
    lines = re.findall(r"^\|(.*)\|$", re.split(r"^#", part, flags=re.MULTILINE)[0], re.MULTILINE)
    names, _, *cells = [[cell.strip() for cell in line.split("|")] for line in lines]
    return [dict(zip(names, row, strict=True)) for row in cells]


def asked(records: list[bus_log.Chunk]) -> list[Packet]:
    """Return the requests among records."""
    return [p for r in records if not r.came_in for p in Parser().feed(r.data)]


def requests(records: list[bus_log.Chunk], device: int) -> list[tuple[str, str, bytes]]:
    """Return what one motor was asked: instruction, register, what was written."""
    names = {r.address: n for n, r in vars(reg).items() if isinstance(r, reg.Register)}
    found = []
    for packet in (p for p in asked(records) if p.id == device):
        kind, address = Instruction(packet.instruction), packet.parameters[:2]
        register = f"`{names[int.from_bytes(address, 'little')]}`" if address else ""
        written = packet.parameters[2:] if kind is Instruction.WRITE else b""
        found.append((kind.name.lower(), register, written))
    return found


def test_the_page_lists_all_registers() -> None:
    table = {row["register"].strip("`"): row for row in rows("Registers")}
    for name, row in table.items():
        assert (int(row["address"]), int(row["bytes"])) == getattr(reg, name), name
    assert list(table) == sorted(table, key=lambda name: getattr(reg, name).address)
    for heading in ("The block", "Settings", "Connect", "Enable", "Leave"):
        named = {row["register"].strip("`") for row in rows(heading)}
        assert named - {"", "*Settings*"} <= {*table}


def test_the_page_shows_the_block_that_is_read() -> None:
    table, offset = rows("The block"), 0
    assert [getattr(reg, row["register"].strip("`")) for row in table] == list(reg.BLOCK)
    for row, register in zip(table, reg.BLOCK, strict=True):
        assert (int(row["offset"]), int(row["bytes"])) == (offset, register.size)
        offset += register.size
    assert f"{reg.BLOCK_SIZE} bytes" in PAGE


def test_the_page_names_the_errors() -> None:
    table = {int(row["number"]): row["refusal"] for row in rows("The error byte")}
    assert table == {int(refusal): refusal.text for refusal in Refusal}
    latched = rows("Hardware errors")
    found = {int(row["bit"], 16): row["kind"] for row in latched}
    assert found == {bit: kind for bit, (kind, *_) in reg.HARDWARE_ERRORS.items()}
    shutting = sum(int(row["bit"], 16) for row in latched if row["switches torque off"] == "yes")
    assert shutting == reg.DEFAULT_SHUTDOWN


@pytest.mark.parametrize("phase", ["connect", "enable", "leave"])
@pytest.mark.parametrize("device", [1, 2])
def test_the_page_lists_the_requests_in_order(talk: Talk, phase: str, device: int) -> None:
    found = requests(getattr(talk, phase), device)
    table = [wanted for row in rows(phase.title()) for wanted in expanded(row, found, device)]
    assert [f[:2] for f in found] == [(row["instruction"], row["register"]) for row in table]
    for row, (_, _, data) in zip(table, found, strict=True):
        if values := re.findall(r"\d+", row["value"]):
            assert int.from_bytes(data, "little") == int(values[-1 if device == LIMITED else 0])
        elif row["value"] == "of the block":
            assert unpack(f"<{reg.BLOCK_SIZE}H", data) == reg.BLOCK_ADDRESSES


def expanded(
    row: dict[str, str], found: list[tuple[str, str, bytes]], device: int
) -> list[dict[str, str]]:
    """Return the rows that a row stands for: the settings that were written, in their order."""
    if row["register"] != "*Settings*":
        return [row]
    written = {register for kind, register, _ in found if kind == "write"} - {"`STATUS_LEVEL`"}
    made = []
    for setting in rows("Settings"):
        kept = getattr(reg, setting["register"].strip("`")).address < reg.EEPROM_END
        unlimited = device != LIMITED and "limit" in setting["value"]
        chosen = setting["otherwise"] == "set" and kept is (row["when"] == "below 64")
        if chosen and not unlimited and setting["register"] in written:
            made.append({**setting, "instruction": "write"})
    assert made or row["when"] != "below 64"  # as sold, a motor needs some
    return made


def test_the_page_lists_the_settings() -> None:
    handle, model = Handle(id=1, current_limit_a=1.0), XM430_W350
    wish = Wish(handle=handle, model=model, units=model.units)
    table = rows("Settings")
    assert [getattr(reg, r["register"].strip("`")) for r in table] == [s.register for s in SETTINGS]
    assert [r["otherwise"] for r in table] == [s.policy.value for s in SETTINGS]
    for row, setting in zip(table, SETTINGS, strict=True):
        if values := re.findall(r"\d+", row["value"]):
            assert int(values[-1]) == setting.wanted(wish), setting.name


def test_nothing_is_written_before_all_motors_are_known(talk: Talk) -> None:
    kinds = [Instruction(p.instruction).name for p in asked(talk.connect) if p.id in (1, 2)]
    assert kinds[:4] == ["PING", "PING", "WRITE", "WRITE"]


def test_torque_is_switched_off_at_every_motor_first(talk: Talk) -> None:
    first = [packet.id for packet in asked(talk.connect)][4:8]  # after both pings and levels
    assert first == [1, 1, 2, 2]


def test_the_page_shows_the_bytes_of_one_cycle(talk: Talk) -> None:
    (block,) = re.findall(r"^```text\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    first, second, *answers = [
        bytes.fromhex("".join(re.findall(r"^(?:[0-9A-F]{2} )+", part, re.MULTILINE)))
        for part in block.split("\n\n")
    ]
    assert first + second == b"".join(r.data for r in talk.cycle if not r.came_in)
    assert b"".join(answers) == b"".join(r.data for r in talk.cycle if r.came_in)


def test_the_page_explains_every_byte_of_an_answer() -> None:
    lines = re.findall(r"^((?:[0-9A-F]{2} )+) +([A-Z_]+) (-?\d+)$", PAGE, re.MULTILINE)
    assert [getattr(reg, name) for _, name, _ in lines] == 2 * list(reg.BLOCK)
    for data, name, value in lines:
        raw = bytes.fromhex(data)
        assert len(raw) == getattr(reg, name).size
        assert int.from_bytes(raw, "little", signed=name != "TICK") == int(value)
