"""`endolock emulator`: two servos on a serial line whose motors turn the twin's handles."""

from __future__ import annotations

import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from endolock.hw.api import ConfigError
from endolock.hw.dynamixel.port import DEFAULT_BAUD
from endolock.hw.dynamixel.registers import BAUDS
from endolock.hw.emulator.wire_faults import parse
from endolock.scripts.commands.run import INSTRUMENT
from endolock.twin.hil.hil_server import HilServer
from endolock.twin.hil.messages import HilSetup
from endolock.twin.world import instrument_files, scenario
from endolock.twin.world.instrument import NUMERICS


@dataclass(frozen=True, kw_only=True)
class Request:
    """Emulate two Dynamixel X-series servos, ids 1 and 2, on a pseudo-terminal, until Ctrl-C.

    A program that opens it, such as endolock run --rig serial:PATH or a script with the vendor's
    library, finds motors that turn the handles of a simulated endoscope.
    """

    link: tyro.conf.DisallowNone[Path | None] = None
    """Name of the line, a symbolic link that is replaced; default: /dev/pts/N, which is printed."""
    baud: int = DEFAULT_BAUD
    """Baud rate of the servos; clients with a different one get no answer."""
    paced: bool = True
    """Answer at the speed of a wire; --no-paced: at once."""
    fault: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """A fault, can be given several times: drop, flip, duplicate, insert, truncate, late or lost
    as in flip=0.05 (fraction of packets); reset, overload, overheat, voltage or encoder as in
    reset:2@5 (motor, seconds); silence or unplug as in unplug@3+1 (seconds, duration)."""
    video: tyro.conf.DisallowNone[int | None] = None
    """Serve the picture of the tip camera, 0.4 s late, as Motion JPEG on this TCP port of this
    machine; the source of the camera in bench.toml is then http://127.0.0.1:PORT/."""
    scenario: str = "rest"
    """With --video: motion of the board in front of the camera, as for run. Where nothing moves,
    pictures without noise are equal, and eyes refuse them as those of a camera that repeats one."""
    instrument: Annotated[str, tyro.conf.arg(help=INSTRUMENT)] = "pretensioned"
    seed: int = 0
    """Seed of the random faults."""


def main(request: Request) -> int:
    """Carry out `endolock emulator`; return the exit code."""
    if request.baud not in BAUDS:
        known = ", ".join(map(str, BAUDS))
        raise ConfigError(f"the servos do not support baud {request.baud}", f"use {known}")
    if request.seed < 0:
        raise ConfigError(f"seed {request.seed}", "use a whole number, 0 or more")
    setup = HilSetup(
        scenario=scenario.load(request.scenario),
        instrument=instrument_files.load(request.instrument),
        numerics=NUMERICS["default"],
        seed=request.seed,
        pictures=request.video is not None,
        overview=False,
        wall=True,
        paced=request.paced,
        baud=request.baud,
        faults=tuple(parse(text) for text in request.fault),
        link=request.link,
        video=request.video,
    )
    signals: list[int] = []
    before = {
        number: signal.signal(number, lambda n, _: signals.append(n))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        with HilServer(setup) as server:
            camera = f", camera at {server.stream.address}" if server.stream else ""
            Console(highlight=False).print(
                f"ready: two servos, ids 1 and 2, at {request.baud} baud on "
                f"{server.line.path}{camera}; Ctrl-C ends",
                soft_wrap=True,
                markup=False,
            )
            server.serve(None, lambda: bool(signals))
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    return 0
