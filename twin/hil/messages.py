"""What a hardware-in-the-loop rig and its server process send each other at the start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from endolock.hw.api import BoardGeometry, Calibration
from endolock.hw.emulator.wire_faults import WireFault
from endolock.twin.world.instrument import Instrument, Numerics
from endolock.twin.world.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class HilSetup:
    """Parameters of the server."""

    scenario: Scenario
    instrument: Instrument
    numerics: Numerics
    seed: int
    pictures: bool
    overview: bool
    wall: bool
    """Whether time is wall-clock time; otherwise lock-step."""
    paced: bool
    baud: int
    """Baud rate of the servos [1/s]."""
    faults: tuple[WireFault, ...]
    link: Path | None = None
    """Symbolic link to the line; None for no link."""
    video: int | None = None
    """TCP port on which the tip camera's pictures are served; None for no stream."""


@dataclass(frozen=True, kw_only=True)
class Ready:
    """What the server offers, sent once it has started."""

    port: str
    origin: float | None
    """Origin of the wall clock; None in lock-step."""
    timestep_s: float
    calibration: Calibration
    board: BoardGeometry
    overview: Calibration | None
    tracked: bool
    described: Mapping[str, Any]
