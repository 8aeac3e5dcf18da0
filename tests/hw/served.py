"""Emulated servos behind a pty, in this process and in wall-clock time."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from threading import Event, Thread
from types import TracebackType
from typing import Self

from tests.hw.emulated import LagMotor

from endolock.hw.bench.wall_clock import WallClock
from endolock.hw.dynamixel.packets import Parser
from endolock.hw.emulator.bus_server import BusServer
from endolock.hw.emulator.emulated_bus import EmulatedBus
from endolock.hw.emulator.pty_line import PtyLine
from endolock.hw.emulator.servo_model import Servo


class HeardBus(EmulatedBus):
    """Remembers what it was asked."""

    def __init__(self, servos: Sequence[Servo]) -> None:
        super().__init__(servos, time.monotonic)
        self._heard = Parser()
        self.asked: set[int] = set()

    def respond(self, data: bytes, baud: int | None = None) -> list[bytes]:
        """Take bytes in, return answers."""
        self.asked |= {packet.instruction for packet in self._heard.feed(data)}
        return super().respond(data, baud)


class Served:
    """Servos behind a pty, served by a thread."""

    def __init__(self, *servos: Servo, link: Path | None = None) -> None:
        self.bus, self.line = HeardBus(servos), PtyLine(link)
        self._emulator = BusServer(self.bus, self.line)
        self._stop, self.pull = Event(), Event()
        """While set, the plug is pulled."""
        self._thread = Thread(target=self._run)

    @property
    def path(self) -> str:
        """The client's end."""
        return self.line.path

    def _run(self) -> None:
        while not self._stop.is_set():
            if self.pull.is_set():
                self.line.unplug()
            elif not self.line.plugged:
                self.line.plug_in()
            for servo in self.bus.servos:
                servo.watch()
            if self.line.wait(0.01):
                self._emulator.answer()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join()
        self.line.close()


def servo(device: int, angle_rad: float = 0.0, *, baud: int = 1_000_000) -> Servo:
    """Make one as the factory does, but for id and baud rate."""
    motor = LagMotor(WallClock(0.0), angle_rad)
    return Servo(motor, device=device, now=time.monotonic, baud=baud)
