"""Packets of Protocol 2.0, byte for byte: made, found again, never mistaken."""

from __future__ import annotations

import importlib
from struct import unpack

import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.hw.dynamixel.packets import (
    ALERT,
    BROADCAST,
    HEADER,
    LONGEST,
    Instruction,
    Packet,
    Parser,
    Refusal,
    crc,
    encode,
    encode_fast,
    split_fast,
)

STATUS = Instruction.STATUS
MANUAL = {
    "ping": "FF FF FD 00 01 03 00 01 19 4E",
    "ping answered": "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D",
    "ping to all": "FF FF FD 00 FE 03 00 01 31 42",
    "read": "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15",
    "read answered": "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0",
    "write": "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89",
    "write answered": "FF FF FD 00 01 04 00 55 00 A1 0C",
    "reg write": "FF FF FD 00 01 09 00 04 68 00 C8 00 00 00 AE 8E",
    "action": "FF FF FD 00 01 03 00 05 02 CE",
    "reboot": "FF FF FD 00 01 03 00 08 2F 4E",
    "sync read": "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA",
    "sync write": "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
    "bulk read": "FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05",
    "bulk write": "FF FF FD 00 FE 10 00 93 01 20 00 02 00 A0 00 02 1F 00 01 00 50 B7 68",
}
"""Frames shown in the e-Manual."""
FAST = bytes.fromhex("""
    FF FF FD 00 FE 19 00 55 00 03 A6 00 00 00 84 08
    00 07 1F 08 00 00 16 CA 00 04 FF 03 00 00 D1 9E
""")
"""Its answer of three motors to a fast sync read."""
FILLER = bytes(LONGEST + 7)
"""More than any packet may claim: whatever was waited for has come."""
GOOD = Packet(2, STATUS, bytes.fromhex("00 1F 08 00 00"))
BLOCK = bytes.fromhex("14 01 00 3E 08 00 00 FA 00 FB FF FD FF FF FF 34 08 00 00")

ids = st.integers(0, 252) | st.just(BROADCAST)
# Parts of a header, and instructions, much more often than chance would have them.
contents = st.binary(max_size=60) | st.lists(
    st.sampled_from([0xFF, 0xFF, 0xFD, 0xFD, 0x00, 0x55, 0xFE]), max_size=60
).map(bytes)
packets = st.builds(Packet, ids, st.integers(0, 255), contents).filter(
    lambda p: (p.id, p.instruction) != (BROADCAST, STATUS)  # the answer of several: no stuffing
)
noises = contents.filter(lambda data: HEADER[:3] not in data)


def whole(packet: Packet) -> bytes:
    """Encode a packet."""
    return encode(*packet)


def fed(stream: bytes, cuts: list[int]) -> list[Packet]:
    """Return what a parser finds in a stream that comes in pieces."""
    parser, found, places = Parser(), [], sorted(cut % (len(stream) + 1) for cut in cuts)
    for start, end in zip([0, *places], [*places, len(stream)], strict=True):
        found += parser.feed(stream[start:end])
    return found


def slow_crc(data: bytes) -> int:
    """Divide bit by bit."""
    rest = 0
    for byte in data:
        rest ^= byte << 8
        for _ in range(8):
            rest = (rest << 1 ^ (0x8005 if rest & 0x8000 else 0)) & 0xFFFF
    return rest


@pytest.mark.parametrize("frame", MANUAL.values(), ids=MANUAL.keys())
def test_frames_are_those_of_the_manual(frame: str) -> None:
    raw = bytes.fromhex(frame)
    packet = Packet(raw[4], raw[7], raw[8:-2])
    assert whole(packet) == raw
    assert Parser().feed(raw) == [packet]


@given(st.binary(max_size=100))
def test_the_checksum_is_that_of_a_long_division(data: bytes) -> None:
    assert crc(data) == slow_crc(data)


@given(packets, st.lists(st.integers(0, 200), max_size=8))
def test_every_packet_is_parsed_however_it_is_split(packet: Packet, cuts: list[int]) -> None:
    raw = whole(packet)
    assert fed(raw, cuts) == [packet]
    assert fed(raw, list(range(len(raw)))) == [packet]  # byte by byte


@given(packets)
def test_a_stuffed_packet_contains_no_second_header(packet: Packet) -> None:
    raw = whole(packet)
    assert HEADER not in raw[1:-2]  # a checksum may be anything
    assert unpack("<H", raw[5:7])[0] == len(raw) - 7


@pytest.mark.parametrize("before", range(4))
@pytest.mark.parametrize("after", range(4))
def test_a_header_is_stuffed_at_any_position(before: int, after: int) -> None:
    parameters = bytes(before) + HEADER[:3] + b"\xfd" * after
    raw = encode(1, Instruction.WRITE, parameters)
    assert raw[8:-2] == bytes(before) + HEADER[:3] + b"\xfd" + b"\xfd" * after
    assert Parser().feed(raw) == [Packet(1, Instruction.WRITE, parameters)]


def test_stuffing_begins_with_the_instruction() -> None:
    assert encode(1, 0xFF, b"\xff\xfd")[7:-2] == b"\xff\xff\xfd\xfd"


@given(st.lists(st.tuples(noises, packets), max_size=5), st.lists(st.integers(0, 999), max_size=8))
def test_bytes_between_packets_are_skipped(
    parts: list[tuple[bytes, Packet]], cuts: list[int]
) -> None:
    stream = b"".join(noise + whole(packet) for noise, packet in parts)
    assert fed(stream, cuts) == [packet for _, packet in parts]


@given(contents, packets)
def test_a_false_header_delays_a_packet_but_does_not_hide_it(garbage: bytes, good: Packet) -> None:
    assert Parser().feed(garbage + HEADER + garbage + whole(good) + FILLER)[-1] == good


@given(packets, st.integers(0, 999), st.integers(1, 255), packets)
def test_a_damaged_packet_costs_only_itself(
    packet: Packet, place: int, change: int, good: Packet
) -> None:
    raw = bytearray(whole(packet))
    raw[place % len(raw)] ^= change
    found = Parser().feed(bytes(raw) + whole(good) + FILLER)
    assert found[-1] == good
    assert packet not in found[:-1]


def test_no_flipped_bit_yields_another_packet() -> None:
    raw = encode(1, STATUS, b"\x00" + BLOCK)
    assert len(raw) == 30
    for bit in range(8 * len(raw)):
        flipped = bytearray(raw)
        flipped[bit // 8] ^= 1 << bit % 8
        assert Parser().feed(bytes(flipped) + whole(GOOD) + FILLER) == [GOOD], bit


def test_no_missing_byte_yields_another_packet() -> None:
    raw = encode(1, STATUS, b"\x00" + BLOCK)
    for place in range(len(raw)):
        for spoilt in (raw[:place], raw[place + 1 :], raw[:place] + raw[place + 1 :]):
            assert Parser().feed(spoilt + whole(GOOD) + FILLER) == [GOOD], place


def test_a_good_packet_is_found_within_what_a_damaged_one_claims() -> None:
    parser = Parser()
    claims = HEADER + b"\x01\x40\x00" + bytes(3)  # 64 bytes are to follow
    assert parser.feed(claims + whole(GOOD)) == []
    assert parser.feed(bytes(64 - 3 - len(whole(GOOD)))) == [GOOD]
    assert parser.damaged == 1


def test_a_length_beyond_the_maximum_is_not_waited_for() -> None:
    for length in (0, 2, LONGEST + 1, 0xFFFF):
        claims = HEADER + b"\x01" + length.to_bytes(2, "little")
        assert Parser().feed(claims + whole(GOOD)) == [GOOD]


@pytest.mark.parametrize("start", ["FF FF FD 00 01 02 00", "FF FF FD 01 01 03 00 01"])
def test_a_wrong_length_or_reserved_byte_is_rejected_despite_a_valid_checksum(start: str) -> None:
    raw = bytes.fromhex(start)
    assert Parser().feed(raw + crc(raw).to_bytes(2, "little") + whole(GOOD)) == [GOOD]


def test_an_unfinished_packet_is_visible_and_can_be_discarded() -> None:
    parser = Parser()
    assert not parser.partial
    for size in range(1, 15):
        assert parser.feed(whole(GOOD)[:size]) == []
        assert parser.partial
        parser.reset()
        assert not parser.partial
        assert parser.feed(whole(GOOD)) == [GOOD]
        assert not parser.partial


def test_noise_does_not_count_as_an_unfinished_packet() -> None:
    parser = Parser()
    assert parser.feed(b"noise \xff\xff\xfe") == []
    assert not parser.partial
    assert parser.feed(b"noise \xff") == []
    assert parser.partial  # it may be a header's first byte


def test_a_fast_answer_is_that_of_the_manual() -> None:
    answers = [(0, 3, b"\xa6\0\0\0"), (0, 7, b"\x1f\x08\0\0"), (0, 4, b"\xff\x03\0\0")]
    assert encode_fast(answers) == FAST
    (packet,) = Parser().feed(FAST)
    assert (packet.id, packet.instruction) == (BROADCAST, STATUS)
    assert split_fast(packet.parameters, 4) == answers


@given(st.integers(0, 20).flatmap(lambda n: st.lists(st.binary(min_size=n, max_size=n))))
def test_a_fast_answer_comes_back_unstuffed_with_running_checksums(parts: list[bytes]) -> None:
    parts = (parts or [b""])[:20]
    size = len(parts[0])
    answers = [(ALERT, n, data) for n, data in enumerate(parts)]
    raw = encode_fast(answers)
    (packet,) = Parser().feed(raw)
    assert split_fast(packet.parameters, size) == answers
    for end in range(8 + size + 4, len(raw) + 1, size + 4):
        assert unpack("<H", raw[end - 2 : end])[0] == slow_crc(raw[: end - 2])


def test_a_header_in_a_fast_answer_is_data() -> None:
    answers = [(0, 1, HEADER[:3] + b"\xfd"), (0, 2, HEADER)]
    (packet,) = Parser().feed(encode_fast(answers))
    assert split_fast(packet.parameters, 4) == answers


def test_a_fast_answer_of_another_length_is_rejected() -> None:
    (packet,) = Parser().feed(FAST)
    assert split_fast(packet.parameters, 5) == []
    assert split_fast(b"", 4) == []


def test_refusals_have_texts() -> None:
    assert [refusal.text for refusal in Refusal] == [
        "failed",
        "instruction",
        "CRC",
        "data range",
        "data length",
        "data limit",
        "access",
    ]


class Recorder:
    """Takes what the vendor's library sends."""

    is_using = False

    def __init__(self) -> None:
        self.sent = b""

    def clearPort(self) -> None:
        """Nothing comes."""

    def writePort(self, packet: list[int]) -> int:
        """Keep it."""
        self.sent = bytes(packet)
        return len(packet)


def vendors(packet: Packet) -> list[int]:
    """Lay a packet out as the vendor's library does, before stuffing and checksum."""
    length = len(packet.parameters) + 3
    head = [*HEADER, packet.id, length & 0xFF, length >> 8, packet.instruction]
    return [*head, *packet.parameters, 0, 0]


@pytest.mark.extra
@given(packets)
def test_the_vendors_library_sends_the_same(packet: Packet) -> None:
    vendor, port = importlib.import_module("dynamixel_sdk").Protocol2PacketHandler(), Recorder()
    assert vendor.txPacket(port, vendors(packet)) == 0
    if whole(packet).count(HEADER[:3]) == 1:  # it forgets the stuffing that it has worked out
        assert port.sent == whole(packet)
    assert vendor.updateCRC(0, port.sent, len(port.sent) - 2) == crc(port.sent[:-2])


@pytest.mark.extra
@given(packets)
def test_the_vendors_library_stuffs_the_same(packet: Packet) -> None:
    vendor = importlib.import_module("dynamixel_sdk").Protocol2PacketHandler()
    assert bytes(vendor.addStuffing(vendors(packet))[:-2]) == whole(packet)[:-2]
