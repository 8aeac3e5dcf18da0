"""The host's side of a servo bus: requests and answers, each with a time-out.

Protocol 2.0 has no sequence numbers, so a late answer looks like one to the next request: bytes
left over are discarded before each request, and a cycle lets its caller check every block.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from struct import pack
from typing import NamedTuple

from endolock.hw.api import Clock, ConfigError, HardwareError, LinkError, LinkLost
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.bus_log import BusLog
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
from endolock.hw.dynamixel.port import Port
from endolock.hw.dynamixel.refusals import explained
from endolock.hw.dynamixel.registers import Register
from endolock.hw.lifecycle import close_all

TIMEOUT_S = 0.020
"""Time-out of the answers to one request [s]. Assumed: an adapter's 16 ms, and some more."""
CYCLE_BYTES = 100
"""Length of two requests and two answers on the line [bytes]."""
ASK_S = 0.050
"""Shortest time-out of a request to a single motor [s]: it is not part of a cycle, so it can wait
until a busy machine has time for it. Assumed."""
TRIES = 3
"""Maximum attempts of a request that has to arrive."""

Accept = Callable[[int, bytes, float, float], bool]
"""Checks a block: index of the motor, its bytes, when the request was sent and when the block was
received [s]; returns whether it answers that request."""


class Cycle(NamedTuple):
    """Result of one request to all motors."""

    blocks: list[bytes | None]
    """Accepted block of each motor, or None."""
    sent_at: float
    """When the request was sent [s]."""
    done_at: float
    """When the last bytes were received [s]; if none were, when the request was sent."""


class Bus:
    """Motors on one port.

    Args:
        port: the line; opened and closed by `open` and `close`.
        clock: stamps errors.
        names: axis of each motor, by id, for messages.
        timeout_s: see `TIMEOUT_S`.
    """

    def __init__(
        self,
        port: Port,
        clock: Clock,
        names: Mapping[int, str],
        timeout_s: float = TIMEOUT_S,
    ) -> None:
        self.port, self._clock, self._names = port, clock, names
        self._timeout_s = timeout_s
        self._log: BusLog | None = None
        self._unlogged: ConfigError | None = None
        self._parser = Parser()
        self._ids = tuple(names)
        self._indices = {device: index for index, device in enumerate(self._ids)}
        block = pack("<HH", reg.INDIRECT_DATA.address, reg.BLOCK_SIZE) + bytes(self._ids)
        self._read_blocks = encode(BROADCAST, Instruction.SYNC_READ, block)
        self._goals = pack("<HH", *reg.GOAL_POSITION)

    def open(self) -> None:
        """Open the port, or open it again."""
        self._stamped(self.port.open)
        self._parser.reset()

    def record(self, path: Path) -> None:
        """Log every byte from now on to a new file; an earlier log is closed.

        For the format see `hw/dynamixel/bus_log.py`.

        Raises:
            ConfigError: it cannot be written, or the earlier one could not be written to its end.
        """
        self.stop_recording()
        self._log = BusLog(path)

    def stop_recording(self) -> None:
        """Close the log, if there is one.

        Raises:
            ConfigError: the log could not be written to its end.
        """
        if self._log:
            self._log.close()
            self._log = None
        if self._unlogged:
            error, self._unlogged = self._unlogged, None
            raise error

    def close(self) -> None:
        """Close the port and the log.

        Raises:
            ConfigError: the log could not be written to its end.
        """
        close_all(self.port.close, self.stop_recording)

    def ping(self, device: int) -> tuple[int, int]:
        """Return model number and firmware version of a motor."""
        data = self._ask(device, Instruction.PING, b"", size=3)
        return int.from_bytes(data[:2], "little"), data[2]

    def scan(self) -> dict[int, tuple[int, int]]:
        """Return model number and firmware of every motor that answers to a broadcast ping."""
        found = {}
        for packet in self._collect(encode(BROADCAST, Instruction.PING)):
            if len(packet.parameters) == 4:
                _, low, high, firmware = packet.parameters
                found[packet.id] = low + 256 * high, firmware
        return found

    def read(self, device: int, register: Register) -> int:
        """Read a register as a signed number."""
        data = self._ask(device, Instruction.READ, pack("<HH", *register), size=register.size)
        return register.decode(data)

    def write(self, device: int, register: Register, value: int | bytes) -> None:
        """Write a register.

        Raises:
            HardwareError: the motor refused.
        """
        if isinstance(value, int):
            value = register.encode(value)
        self._ask(device, Instruction.WRITE, pack("<H", register.address) + value, size=0)

    def reboot(self, device: int) -> None:
        """Restart a motor; it answers again after a moment."""
        with suppress(LinkLost):  # it may restart before its answer arrives
            self._ask(device, Instruction.REBOOT, b"", size=0)

    def sync_write(self, register: Register, values: Mapping[int, int]) -> None:
        """Write one register of several motors at once; they do not answer."""
        data = pack("<HH", *register)
        for device, value in values.items():
            data += bytes((device,)) + register.encode(value)
        request = encode(BROADCAST, Instruction.SYNC_WRITE, data)
        self._stamped(lambda: self._send(request))

    def sync_read(
        self, devices: Sequence[int], register: Register, *, fast: bool = False
    ) -> dict[int, int]:
        """Read one register of several motors at once, signed; silent motors are left out.

        Args:
            devices: ids.
            register: the register.
            fast: let them answer in one packet, which their firmware must support.
        """
        kind = Instruction.FAST_SYNC_READ if fast else Instruction.SYNC_READ
        data = pack("<HH", *register) + bytes(devices)
        who = (BROADCAST,) if fast else tuple(devices)
        found = {}
        for packet in self._collect(encode(BROADCAST, kind, data), who):
            parts = [(packet.parameters[0], packet.id, packet.parameters[1:])]
            if fast:
                parts = split_fast(packet.parameters, register.size)
            for _, device, part in parts:
                if len(part) == register.size:
                    found[device] = register.decode(part)
        return found

    def bulk_read(self, registers: Mapping[int, Register]) -> dict[int, int]:
        """Read a different register of each motor at once, as signed numbers; see `sync_read`.

        Args:
            registers: the register of each motor, by id.
        """
        data = b"".join(pack("<BHH", device, *r) for device, r in registers.items())
        request = encode(BROADCAST, Instruction.BULK_READ, data)
        answers = {p.id: p.parameters[1:] for p in self._collect(request, tuple(registers))}
        return {
            device: register.decode(answers[device])
            for device, register in registers.items()
            if len(answers.get(device, b"")) == register.size
        }

    def cycle(self, goals: Sequence[int | None] | None, accept: Accept) -> Cycle:
        """Send goals and read all blocks in one transaction.

        Args:
            goals: of each motor [counts]; None keeps a motor's goal; None to read only.
            accept: checks each block.

        Raises:
            OverflowError: a goal is too large for its register; nothing was sent.
            PortGone: the port was unplugged.
        """
        request = self._read_blocks
        if goals is not None:
            parts = (
                bytes((i,)) + reg.GOAL_POSITION.encode_signed(g)
                for i, g in zip(self._ids, goals, strict=True)
                if g is not None
            )
            data = self._goals + b"".join(parts)
            request = encode(BROADCAST, Instruction.SYNC_WRITE, data) + request
        found: list[bytes | None] = [None] * len(self._ids)
        missing = len(found)
        try:
            self._drain()
            sent_at = done_at = self._send(request)
            give_up = time.monotonic() + self._timeout_s
            while missing:
                data, came_at = self._receive(give_up - time.monotonic())
                if not data:
                    break
                done_at = came_at
                for packet in self._parser.feed(data):
                    index = self._indices.get(packet.id, -1)
                    if (
                        index < 0
                        or packet.instruction != Instruction.STATUS
                        or len(packet.parameters) != 1 + reg.BLOCK_SIZE
                        or packet.parameters[0] & ~ALERT
                        or found[index] is not None
                    ):
                        continue
                    if accept(index, packet.parameters[1:], sent_at, came_at):
                        found[index] = packet.parameters[1:]
                        missing -= 1
        except LinkError as error:
            error.t = self._clock.now()
            raise
        return Cycle(found, sent_at, done_at)

    def _ask(self, device: int, kind: Instruction, parameters: bytes, *, size: int) -> bytes:
        """Send a request to one motor until it answers; return the data of the answer."""
        request = encode(device, kind, parameters)
        timeout_s = max(self._timeout_s, ASK_S)
        for _ in range(TRIES):
            for packet in self._collect(request, (device,), timeout_s):
                error, data = packet.parameters[0] & ~ALERT, packet.parameters[1:]
                if error == Refusal.CRC:
                    continue
                if error:
                    what, step = explained(kind, parameters, error)
                    raise HardwareError(
                        f"handle motor {self._named(device)} {what}",
                        step,
                        t=self._clock.now(),
                        axis=self._names.get(device),
                    )
                if len(data) == size:
                    return data
        raise LinkLost(
            f"handle motor {self._named(device)} did not answer within {timeout_s:.3f} s on "
            f"{self.port.name} ({TRIES} tries)",
            "check power and cable, then run endolock doctor",
            t=self._clock.now(),
            axis=self._names.get(device),
        )

    def _collect(
        self, request: bytes, who: Collection[int] | None = None, timeout_s: float | None = None
    ) -> list[Packet]:
        """Send a request; return the status packet of each of these ids, or of all that answer.

        Args:
            request: bytes to send.
            who: ids whose answers are waited for, one each; None: all that answer in time.
            timeout_s: longest wait [s]; that of the bus if None.
        """
        found: list[Packet] = []

        def talk() -> None:
            self._drain()
            self._send(request)
            give_up = time.monotonic() + (timeout_s or self._timeout_s)
            while who is None or len(found) < len(who):
                data, _ = self._receive(give_up - time.monotonic())
                if not data:
                    return
                for packet in self._parser.feed(data):
                    answers = packet.instruction == Instruction.STATUS and packet.parameters
                    if answers and (who is None or packet.id in who):
                        found.append(packet)

        self._stamped(talk)
        return found

    def _drain(self) -> None:
        """Discard bytes left over from before."""
        self._parser.reset()
        for _ in range(64):  # a line that never falls silent is not a bus
            if not self._receive(0.0)[0]:
                return

    def _send(self, data: bytes) -> float:
        """Send bytes; return the time as logged [s]."""
        now = self._clock.now()
        self.port.send(data)
        self._log_bytes(now, False, data)
        return now

    def _receive(self, timeout_s: float) -> tuple[bytes, float]:
        """Return the bytes received, and the time as logged [s]."""
        data = self.port.receive(timeout_s)
        now = self._clock.now()
        if data:
            self._log_bytes(now, True, data)
        return data, now

    def _log_bytes(self, t: float, came_in: bool, data: bytes) -> None:
        """Log bytes; a failing log must not keep the motors from being stopped."""
        if self._log:
            try:
                self._log.append(t, came_in, data)
            except ConfigError as error:
                self._log.close()
                self._log, self._unlogged = None, error

    def _stamped(self, call: Callable[[], object]) -> None:
        try:
            call()
        except LinkError as error:
            error.t = self._clock.now()
            raise

    def _named(self, device: int) -> str:
        name = self._names.get(device)
        return f"{device} ({name})" if name else str(device)
