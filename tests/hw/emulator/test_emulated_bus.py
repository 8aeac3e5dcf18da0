"""What servos on one line answer to which bytes, and when they keep silent."""

from __future__ import annotations

from collections.abc import Sequence
from struct import pack

import pytest
from tests.hw.emulated import BenchClock, LagMotor

from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.models import XM430_W350
from endolock.hw.dynamixel.packets import (
    ALERT,
    BROADCAST,
    Instruction,
    Packet,
    Parser,
    Refusal,
    encode,
    split_fast,
)
from endolock.hw.dynamixel.registers import Register
from endolock.hw.emulator.control_table import FIRMWARE
from endolock.hw.emulator.emulated_bus import UNFINISHED_S, EmulatedBus
from endolock.hw.emulator.servo_model import Servo

CENTRE = 2048
SETTLED_S = 1.0  # forty lags of the motors
HELLO = pack("<HB", XM430_W350.number, FIRMWARE)
"""What a servo answers to a ping."""
NOWHERE = Register(reg.END, 4)
FACTORY_RESET = 0x06
"""An instruction that is not emulated."""


class Line:
    """Two servos, as sold but at 1 Mbaud; the later id comes first on the line."""

    def __init__(self) -> None:
        self.clock = BenchClock()
        motors = [LagMotor(self.clock, angle) for angle in (-0.2, 0.3)]
        now = self.clock.now
        self.second, self.first = self.servos = [
            Servo(motor, device=device, now=now, reboot_s=0.3)
            for motor, device in zip(motors, (2, 1), strict=True)
        ]
        self.clock.servos = self.servos
        self.bus = EmulatedBus(self.servos, now)

    def respond(self, data: bytes, baud: int | None = None) -> list[Packet]:
        """Send bytes; return the answers, each of which is one whole packet."""
        found = []
        for answer in self.bus.respond(data, baud):
            (packet,) = Parser().feed(answer)
            assert packet.instruction == Instruction.STATUS
            found.append(packet)
        return found

    def ask(self, device: int, kind: int, parameters: bytes = b"") -> list[tuple[int, int, bytes]]:
        """Send a request; return id, error and data of each answer."""
        answers = self.respond(encode(device, kind, parameters))
        return [(p.id, p.parameters[0], p.parameters[1:]) for p in answers]

    @property
    def goals(self) -> tuple[int, ...]:
        """What they aim at, in the order of their ids."""
        return tuple(value(servo, reg.GOAL_POSITION) for servo in (self.first, self.second))

    def wait(self, seconds: float) -> None:
        """Let time pass in silence."""
        self.clock.sleep_until(self.clock.now() + seconds)


@pytest.fixture
def line() -> Line:
    """Plug two servos in."""
    return Line()


def at(register: Register, data: bytes = b"") -> bytes:
    """Address a register, to write it."""
    return pack("<H", register.address) + data


def of(register: Register, devices: Sequence[int] = ()) -> bytes:
    """Address a register, to read it, of several devices."""
    return pack("<HH", *register) + bytes(devices)


def value(servo: Servo, register: Register) -> int:
    """Look into a servo, without the line."""
    return register.decode(servo.read(*register))


GOAL = at(reg.GOAL_POSITION, pack("<i", 2200))
GOALS = of(reg.GOAL_POSITION) + pack("<BiBi", 1, 2200, 2, 1900)
POSITION = pack("<i", CENTRE)
DONE = (1, 0, b"")


def refused(why: Refusal, device: int = 1) -> tuple[int, int, bytes]:
    """Return the answer of a servo that does not do it."""
    return device, int(why), b""


# One at a time.


def test_a_ping_is_answered_with_model_and_firmware(line: Line) -> None:
    assert line.ask(1, Instruction.PING) == [(1, 0, HELLO)]
    assert line.ask(2, Instruction.PING) == [(2, 0, HELLO)]


def test_all_servos_answer_a_ping_in_the_order_of_their_ids(line: Line) -> None:
    assert line.ask(BROADCAST, Instruction.PING) == [(1, 0, HELLO), (2, 0, HELLO)]


def test_a_register_is_read(line: Line) -> None:
    assert line.ask(2, Instruction.READ, of(reg.POSITION)) == [(2, 0, POSITION)]


def test_a_register_is_written(line: Line) -> None:
    assert line.ask(1, Instruction.WRITE, GOAL) == [DONE]
    assert line.goals == (2200, CENTRE)


def test_the_reason_for_a_refusal_is_answered(line: Line) -> None:
    assert line.ask(1, Instruction.READ, of(NOWHERE)) == [refused(Refusal.ACCESS)]
    high = at(reg.GOAL_POSITION, pack("<i", 4096))
    assert line.ask(1, Instruction.WRITE, high) == [refused(Refusal.DATA_LIMIT)]
    assert line.ask(1, Instruction.WRITE, at(reg.TICK, b"\0\0")) == [refused(Refusal.ACCESS)]
    assert line.ask(1, Instruction.WRITE, at(reg.BAUD, b"\x09")) == [refused(Refusal.DATA_RANGE)]


def test_registered_writes_are_executed_on_the_action(line: Line) -> None:
    assert line.ask(1, Instruction.REG_WRITE, GOAL) == [DONE]
    assert line.ask(1, Instruction.READ, of(reg.REGISTERED)) == [(1, 0, b"\x01")]
    assert line.goals == (CENTRE, CENTRE)
    assert line.ask(1, Instruction.ACTION) == [DONE]
    assert line.goals == (2200, CENTRE)
    assert line.ask(1, Instruction.ACTION) == [refused(Refusal.INSTRUCTION)]


def test_an_action_broadcast_starts_all_servos_together(line: Line) -> None:
    for device in (1, 2):
        line.ask(device, Instruction.REG_WRITE, GOAL)
    assert line.ask(BROADCAST, Instruction.ACTION) == []
    assert line.goals == (2200, 2200)


def test_a_reboot_is_answered_before_it_happens(line: Line) -> None:
    line.ask(1, Instruction.WRITE, at(reg.TORQUE_ENABLE, b"\x01"))
    line.ask(1, Instruction.REG_WRITE, GOAL)
    assert line.ask(1, Instruction.REBOOT) == [DONE]
    assert line.ask(1, Instruction.PING) == []
    assert line.ask(BROADCAST, Instruction.PING) == [(2, 0, HELLO)]
    line.wait(0.3)
    assert line.ask(1, Instruction.READ, of(reg.TORQUE_ENABLE)) == [(1, 0, b"\x00")]
    assert line.ask(1, Instruction.ACTION) == [refused(Refusal.INSTRUCTION)]


def test_a_new_id_takes_effect_after_the_answer(line: Line) -> None:
    assert line.ask(1, Instruction.WRITE, at(reg.ID, b"\x07")) == [DONE]
    assert line.ask(1, Instruction.PING) == []
    assert line.ask(7, Instruction.PING) == [(7, 0, HELLO)]


# Several at once.


def test_a_sync_write_reaches_the_servos_it_names_without_an_answer(line: Line) -> None:
    assert line.ask(BROADCAST, Instruction.SYNC_WRITE, GOALS) == []
    assert line.goals == (2200, 1900)
    line.ask(BROADCAST, Instruction.SYNC_WRITE, of(reg.GOAL_POSITION) + pack("<BiBi", 9, 1, 2, 2))
    assert line.goals == (2200, 2)


def test_one_servo_may_refuse_its_part_of_a_sync_write(line: Line) -> None:
    goals = of(reg.GOAL_POSITION) + pack("<BiBi", 1, 9999, 2, 1900)
    assert line.ask(BROADCAST, Instruction.SYNC_WRITE, goals) == []
    assert line.goals == (CENTRE, 1900)


def test_the_complete_parts_of_a_truncated_sync_write_are_executed(line: Line) -> None:
    ramps = of(reg.PROFILE) + pack("<BqBq", 1, 11, 2, 22)
    assert line.ask(BROADCAST, Instruction.SYNC_WRITE, ramps[:-1]) == []
    assert [value(servo, reg.PROFILE) for servo in (line.first, line.second)] == [11, 0]


def test_a_sync_read_is_answered_in_the_order_asked(line: Line) -> None:
    line.ask(BROADCAST, Instruction.SYNC_WRITE, GOALS)
    for order in ((1, 2), (2, 1), (2,), (5, 2)):
        answers = line.ask(BROADCAST, Instruction.SYNC_READ, of(reg.GOAL_POSITION, order))
        goals = {1: pack("<i", 2200), 2: pack("<i", 1900)}
        assert answers == [(device, 0, goals[device]) for device in order if device in goals]


def test_each_servo_may_refuse_its_part_of_a_sync_read(line: Line) -> None:
    answers = line.ask(BROADCAST, Instruction.SYNC_READ, of(NOWHERE, (1, 2)))
    assert answers == [refused(Refusal.ACCESS, 1), refused(Refusal.ACCESS, 2)]


def test_a_fast_sync_read_is_answered_in_one_packet(line: Line) -> None:
    line.first.fail("voltage")
    request = encode(BROADCAST, Instruction.FAST_SYNC_READ, of(reg.POSITION, (2, 1)))
    (packet,) = line.respond(request)
    assert packet.id == BROADCAST
    parts = split_fast(packet.parameters, reg.POSITION.size)
    assert parts == [(0, 2, POSITION), (ALERT, 1, POSITION)]


def test_a_fast_answer_needs_every_servo(line: Line) -> None:
    fast = Instruction.FAST_SYNC_READ
    assert line.ask(BROADCAST, fast, of(reg.POSITION, (1, 5))) == []
    assert line.ask(BROADCAST, fast, of(NOWHERE, (1, 2))) == []
    assert line.ask(BROADCAST, fast, of(reg.POSITION)) == []
    line.ask(2, Instruction.WRITE, at(reg.STATUS_LEVEL, b"\x00"))
    assert line.ask(BROADCAST, fast, of(reg.POSITION, (1, 2))) == []


def test_a_bulk_read_reads_a_different_register_of_each_servo(line: Line) -> None:
    registers = ((2, reg.TEMPERATURE), (5, reg.POSITION), (1, reg.VOLTAGE), (2, NOWHERE))
    request = b"".join(pack("<BHH", device, *register) for device, register in registers)
    assert line.ask(BROADCAST, Instruction.BULK_READ, request) == [
        (2, 0, b"\x1e"),
        (1, 0, pack("<H", 120)),
        refused(Refusal.ACCESS, 2),
    ]


def test_a_bulk_write_writes_a_different_register_of_each_servo(line: Line) -> None:
    parts = pack("<BHHi", 2, *reg.GOAL_POSITION, 1900) + pack("<BHHi", 5, *reg.GOAL_POSITION, 3)
    parts += pack("<BHHB", 1, *reg.WATCHDOG, 50)
    assert line.ask(BROADCAST, Instruction.BULK_WRITE, parts) == []
    assert line.goals == (CENTRE, 1900)
    assert value(line.first, reg.WATCHDOG) == 50
    cut = pack("<BHHi", 2, *reg.PROFILE, 1)  # promises twice as much
    assert line.ask(BROADCAST, Instruction.BULK_WRITE, cut) == []
    assert value(line.second, reg.PROFILE) == 0


# Who answers to what.

EVERYTHING = {
    Instruction.PING: b"",
    Instruction.READ: of(reg.POSITION),
    Instruction.WRITE: GOAL,
    Instruction.REG_WRITE: GOAL,
    Instruction.ACTION: b"",
    Instruction.SYNC_READ: of(reg.POSITION, (1,)),
    Instruction.FAST_SYNC_READ: of(reg.POSITION, (1,)),
    Instruction.BULK_READ: pack("<BHH", 1, *reg.POSITION),
    FACTORY_RESET: b"\xff",
    Instruction.REBOOT: b"",
}
TO_ALL = (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ, Instruction.BULK_READ)


@pytest.mark.parametrize("level", [0, 1, 2])
def test_the_status_level_says_what_is_answered(line: Line, level: int) -> None:
    line.ask(1, Instruction.WRITE, at(reg.STATUS_LEVEL, bytes([level])))
    answered = [
        kind
        for kind, parameters in EVERYTHING.items()
        if line.ask(BROADCAST if kind in TO_ALL else 1, kind, parameters)
    ]
    reads = [Instruction.PING, Instruction.READ, *TO_ALL]
    assert answered == ([Instruction.PING], reads, list(EVERYTHING))[level]


@pytest.mark.parametrize("level", [0, 1, 2])
def test_the_status_level_holds_for_refusals_too(line: Line, level: int) -> None:
    line.ask(1, Instruction.WRITE, at(reg.STATUS_LEVEL, bytes([level])))
    nothing_reads = line.ask(1, Instruction.READ, of(NOWHERE)) + line.ask(1, Instruction.READ)
    assert len(nothing_reads) == (0, 2, 2)[level]
    rest = line.ask(1, Instruction.WRITE) + line.ask(1, FACTORY_RESET)
    assert len(rest) == (0, 0, 2)[level]


def test_a_broadcast_is_executed_and_not_answered(line: Line) -> None:
    for kind, parameters in EVERYTHING.items():
        if kind not in (Instruction.PING, *TO_ALL):
            assert line.ask(BROADCAST, kind, parameters) == []
    line.wait(0.3)
    line.ask(BROADCAST, Instruction.WRITE, GOAL)
    assert line.goals == (2200, 2200)


def test_an_unknown_instruction_is_refused(line: Line) -> None:
    for kind in (FACTORY_RESET, 0x10, 0x9A, 0xFF):
        assert line.ask(1, kind, b"\x01") == [refused(Refusal.INSTRUCTION)]
        assert line.ask(BROADCAST, kind, b"\x01") == []


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        (Instruction.READ, b""),
        (Instruction.READ, b"\x84"),
        (Instruction.READ, b"\x84\x00"),
        (Instruction.READ, b"\x84\x00\x04"),
        (Instruction.READ, b"\x84\x00\x04\x00\x00"),
        (Instruction.WRITE, b""),
        (Instruction.WRITE, b"\x40"),
        (Instruction.WRITE, GOAL[:-2]),
        (Instruction.REG_WRITE, b"\x40"),
    ],
)
def test_a_truncated_request_is_refused(line: Line, kind: int, parameters: bytes) -> None:
    assert line.ask(1, kind, parameters) == [refused(Refusal.DATA_LENGTH)]
    assert line.ask(BROADCAST, kind, parameters) == []
    assert line.goals == (CENTRE, CENTRE)


@pytest.mark.parametrize(
    "kind",
    [
        Instruction.SYNC_READ,
        Instruction.FAST_SYNC_READ,
        Instruction.SYNC_WRITE,
        Instruction.BULK_READ,
        Instruction.BULK_WRITE,
    ],
)
def test_a_truncated_broadcast_is_not_answered(line: Line, kind: int) -> None:
    for size in range(4):
        assert line.ask(BROADCAST, kind, b"\x01\x84\x00\x04"[:size]) == []


def test_an_unknown_id_gets_no_answer(line: Line) -> None:
    for kind, parameters in EVERYTHING.items():
        assert line.ask(3, kind, parameters) == []


def test_status_packets_of_other_servos_are_ignored(line: Line) -> None:
    assert line.ask(1, Instruction.STATUS, b"\x00") == []


def test_a_request_at_another_baud_rate_gets_no_answer(line: Line) -> None:
    ping = encode(1, Instruction.PING)
    assert len(line.respond(ping, 1_000_000)) == 1
    assert line.respond(ping, 57_600) == []
    faster = encode(1, Instruction.WRITE, at(reg.BAUD, bytes([reg.BAUDS.index(3_000_000)])))
    assert len(line.respond(faster, 1_000_000)) == 1
    assert line.respond(ping, 1_000_000) == []
    assert len(line.respond(ping, 3_000_000)) == 1
    assert len(line.respond(encode(2, Instruction.PING), 1_000_000)) == 1


@pytest.mark.parametrize("kind", [*EVERYTHING])
def test_every_answer_reports_a_hardware_error(line: Line, kind: int) -> None:
    line.first.fail("overload")
    device = BROADCAST if kind in TO_ALL else 1
    (packet,) = line.respond(encode(device, kind, EVERYTHING[kind]))
    assert packet.parameters[0] & ALERT


def test_a_refusal_and_a_hardware_error_are_in_one_error_byte(line: Line) -> None:
    line.first.fail("overload")
    answers = line.ask(1, Instruction.WRITE, at(reg.TORQUE_ENABLE, b"\x01"))
    assert answers == [(1, ALERT | Refusal.ACCESS, b"")]


# Bytes that went wrong.


def test_a_damaged_request_is_not_answered_and_costs_only_itself(line: Line) -> None:
    write, ping = encode(1, Instruction.WRITE, GOAL), encode(2, Instruction.PING)
    for place in range(7, len(write)):  # behind the length
        spoilt = bytearray(write)
        spoilt[place] ^= 0x10
        assert [packet.id for packet in line.respond(bytes(spoilt) + ping)] == [2]
    assert line.goals == (CENTRE, CENTRE)


def test_a_request_may_come_in_pieces(line: Line) -> None:
    write = encode(1, Instruction.WRITE, GOAL)
    for byte in write[:-1]:
        assert line.respond(bytes([byte])) == []
        line.wait(0.9 * UNFINISHED_S)
    assert len(line.respond(write[-1:])) == 1


def test_an_incomplete_request_is_discarded_after_a_timeout(line: Line) -> None:
    much, ping = encode(1, Instruction.WRITE, bytes(60)), encode(2, Instruction.PING)
    assert line.respond(much[:10]) == []
    line.wait(0.9 * UNFINISHED_S)
    assert line.respond(ping) == []  # taken for more of it
    line.wait(1.1 * UNFINISHED_S)
    assert [packet.id for packet in line.respond(ping)] == [2]


def test_two_requests_may_come_together(line: Line) -> None:
    both = encode(1, Instruction.WRITE, GOAL) + encode(1, Instruction.READ, of(reg.GOAL_POSITION))
    assert [packet.parameters for packet in line.respond(both)] == [b"\0", b"\0" + pack("<i", 2200)]


# The watchdog on the line.


def test_a_packet_to_a_motor_or_a_broadcast_feeds_its_watchdog(line: Line) -> None:
    for device in (1, 2):
        line.ask(device, Instruction.WRITE, at(reg.TORQUE_ENABLE, b"\x01"))
        line.ask(device, Instruction.WRITE, at(reg.WATCHDOG, b"\x02"))
    for _ in range(5):
        line.wait(0.030)
        line.ask(BROADCAST, Instruction.SYNC_WRITE, GOALS)
    assert [value(servo, reg.WATCHDOG) for servo in line.servos] == [2, 2]
    for _ in range(5):
        line.wait(0.030)
        line.ask(1, Instruction.PING)
    assert value(line.first, reg.WATCHDOG) == 2
    assert value(line.second, reg.WATCHDOG) == reg.TRIPPED


def test_after_a_trip_sync_writes_have_no_effect_until_the_watchdog_is_off(line: Line) -> None:
    line.ask(1, Instruction.WRITE, at(reg.TORQUE_ENABLE, b"\x01"))
    line.ask(1, Instruction.WRITE, at(reg.WATCHDOG, b"\x02"))
    line.wait(0.042)
    line.ask(BROADCAST, Instruction.SYNC_WRITE, GOALS)
    line.wait(SETTLED_S)
    assert line.ask(1, Instruction.READ, of(reg.POSITION)) == [(1, 0, POSITION)]
    assert line.ask(1, Instruction.WRITE, GOAL) == [refused(Refusal.DATA_RANGE)]
    assert line.ask(1, Instruction.WRITE, at(reg.WATCHDOG, b"\x00")) == [DONE]
    line.ask(BROADCAST, Instruction.SYNC_WRITE, GOALS)
    line.wait(SETTLED_S)
    assert line.ask(1, Instruction.READ, of(reg.POSITION)) == [(1, 0, pack("<i", 2200))]


def test_a_secondary_id_obeys_without_an_answer_and_keeps_its_eeprom(line: Line) -> None:
    line.ask(2, Instruction.WRITE, at(reg.SECONDARY_ID, b"\x01"))
    assert [device for device, *_ in line.ask(1, Instruction.WRITE, GOAL)] == [1]
    assert line.goals == (2200, 2200)
    line.ask(1, Instruction.WRITE, at(reg.RETURN_DELAY, b"\x07"))
    assert [value(servo, reg.RETURN_DELAY) for servo in (line.first, line.second)] == [7, -6]
    assert line.ask(1, Instruction.PING) == [(1, 0, HELLO)]  # only the one with this id
    goals = of(reg.GOAL_POSITION) + pack("<BiBi", 2, 1100, 1, 900)
    line.ask(BROADCAST, Instruction.SYNC_WRITE, goals)
    assert line.goals == (900, 900)
    line.ask(2, Instruction.WRITE, at(reg.SECONDARY_ID, b"\xfd"))  # 253: none
    line.ask(1, Instruction.WRITE, GOAL)
    assert line.goals == (2200, 900)


def test_a_servo_set_to_another_protocol_is_silent(line: Line) -> None:
    line.ask(2, Instruction.WRITE, at(reg.PROTOCOL, b"\x01"))
    assert [device for device, *_ in line.ask(BROADCAST, Instruction.PING)] == [1]
