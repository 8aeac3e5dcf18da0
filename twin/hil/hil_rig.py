"""Hardware in the loop: the drivers of the bench, with the twin behind a serial line.

This process accesses the handles through port, bus and drive as on a bench; the twin, its emulated
servos and its cameras run in a server process. In lock-step a run is bit-identical to that of
`TwinRig`; in wall-clock mode it shows the time spent on the line and in the programs.
"""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from copy import deepcopy
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from endolock.hw import child_processes
from endolock.hw.api import (
    Calibration,
    Clock,
    ConfigError,
    Frame,
    HardwareError,
    Pose,
    TruthSample,
)
from endolock.hw.bench.wall_clock import WallClock
from endolock.hw.dynamixel.port import DEFAULT_BAUD, serial_port
from endolock.hw.dynamixel.servo_bus import TIMEOUT_S, Bus
from endolock.hw.dynamixel.servo_drive import ServoDrive
from endolock.hw.emulator.wire_faults import WireFault
from endolock.hw.guard import Guard
from endolock.hw.lifecycle import ClosingRig, close_after, close_all
from endolock.twin.arguments import CLOSED, parameters, seed_of
from endolock.twin.hil.messages import HilSetup, Ready
from endolock.twin.physics import motor
from endolock.twin.world.instrument import Instrument, Numerics
from endolock.twin.world.scenario import Scenario, load

LOCK_STEP_TIMEOUT_S = 2.0
"""Time-out of the bus in lock-step, where simulated time does not pass during a transfer [s]: long
enough for a busy machine."""
FAREWELL_S = 10.0
"""Time that the server has to end [s]."""


class HilRig(ClosingRig):
    """A twin behind an emulated serial line, with the interface of `TwinRig`.

    Args:
        scenario: name, TOML file or loaded scenario.
        instrument: parameters of the endoscope; `pretensioned` if None.
        numerics: resolution of the simulation; the defaults if None.
        seed: seed of all random numbers, >= 0.
        pictures: whether frames carry pictures; if not, vision must use the truth.
        overview: whether the fixed camera takes pictures too.
        wall: whether time is wall-clock time; otherwise rig and server run in lock-step.
        paced: whether bytes take as long as on a real wire.
        faults: faults of the line.

    Raises:
        ConfigError: the scenario cannot be used, or pictures cannot be rendered.
    """

    def __init__(
        self,
        scenario: str | Path | Scenario = "straight",
        *,
        instrument: Instrument | None = None,
        numerics: Numerics | None = None,
        seed: int = 0,
        pictures: bool = True,
        overview: bool = False,
        wall: bool = False,
        paced: bool = False,
        faults: Sequence[WireFault] = (),
    ) -> None:
        self.seed = seed = seed_of(seed)
        self.instrument = made = parameters(Instrument, instrument)
        numerics = parameters(Numerics, numerics)
        _need_linux()
        self.scenario = load(scenario)
        self.pictures = pictures
        self._far = _Far()
        try:
            ready: Ready = self._far.start(
                HilSetup(
                    scenario=self.scenario,
                    instrument=made,
                    numerics=numerics,
                    seed=seed,
                    pictures=pictures,
                    overview=overview,
                    wall=wall,
                    paced=paced,
                    baud=DEFAULT_BAUD,
                    faults=tuple(faults),
                )
            )
        except BaseException as error:
            close_after(error, self._far.close)
            raise
        self.clock: Clock = (
            WallClock(ready.origin) if wall else _LockStep(self._far, ready.timestep_s)
        )
        self.board = ready.board
        self._described = ready.described
        handles = motor.handles(made)
        names = {handle.id: axis for axis, handle in handles.items()}
        timeout_s = TIMEOUT_S if wall else LOCK_STEP_TIMEOUT_S
        self.line = Bus(serial_port(ready.port, DEFAULT_BAUD), self.clock, names, timeout_s)
        self.drive = ServoDrive(self.line, self.clock, handles, motor.units(made))
        self.actuators: Guard = Guard(self.drive)
        self.camera = _FarCamera(self._far, "frame", ready.calibration)
        self.overview: _FarCamera | None = None
        if ready.overview is not None:
            self.overview = _FarCamera(self._far, "overview", ready.overview)
        self.tracker = _FarTracker(self._far) if ready.tracked else None
        self.truth = _FarTruth(self._far)

    def describe(self) -> Mapping[str, Any]:
        """Return the description of the twin, and that of the line, as plain values."""
        return {**deepcopy(self._described), "line": self.drive.describe()}

    def aim(self, pixel: tuple[float, float]) -> None:
        """Make the point of the board that is now seen at a pixel the target."""
        self.board = self._far.call("aim", pixel)

    def close(self) -> None:
        """Switch the handles off and end the server; may be called twice."""
        close_all(self.actuators.close, self.line.close, self._far.close)


def _need_linux() -> None:
    """Refuse what has no pseudo-terminals.

    Raises:
        ConfigError: this system is not Linux.
    """
    if sys.platform != "linux":
        raise ConfigError("hardware in the loop needs Linux", "run it there, or use --rig twin")


class _Far:
    """The server process, and the side channel to it."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            theirs.set_inheritable(True)
            number = theirs.fileno()
            # In its own session it does not receive Ctrl-C, so that we can stop the handles first.
            self._process = subprocess.Popen(
                child_processes.command("endolock.twin.hil.hil_server", str(number)),
                pass_fds=[number],
                start_new_session=True,
            )
        self._channel: Connection | None = Connection(ours.detach())

    def start(self, setup: HilSetup) -> Any:
        """Send the set-up; return what the server offers."""
        return self._exchange(setup)

    def call(self, name: str, *args: Any) -> Any:
        """Call a function of the server.

        Raises:
            ConfigError, LookupError: raised by the function.
            HardwareError: the server has ended.
        """
        return self._exchange((name, args))

    def close(self) -> None:
        """End the server; may be called twice."""
        if self._channel is None:
            return
        self._channel.close()
        self._channel = None
        try:
            self._process.wait(FAREWELL_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _exchange(self, message: Any) -> Any:
        if self._channel is None:
            raise ConfigError(*CLOSED)
        try:
            self._channel.send(message)
            kind, value = self._channel.recv()
        except (EOFError, ConnectionError):
            raise HardwareError(
                "the server of the emulated bench has ended",
                "read its message above, then start again",
                t=0.0,
            ) from None
        if kind == "error":
            raise value
        return value


class _LockStep:
    """Time of the twin in the server: sleeping advances it."""

    realtime = False

    def __init__(self, far: _Far, timestep_s: float) -> None:
        self._far, self.timestep_s = far, timestep_s
        self._now = 0.0

    def now(self) -> float:
        return self._now

    def sleep_until(self, t: float) -> float:
        self._now = self._far.call("sleep", t)
        return self._now


class _FarCamera:
    """One of the twin's cameras."""

    def __init__(self, far: _Far, name: str, calibration: Calibration) -> None:
        self._far, self._name, self.calibration = far, name, calibration
        self._newest: Frame | None = None

    def latest(self) -> Frame | None:
        seq = self._newest.seq if self._newest else -1
        self._newest = self._far.call(self._name, seq) or self._newest
        return self._newest


class _FarTracker:
    """The twin's pose tracker."""

    def __init__(self, far: _Far) -> None:
        self._far = far

    def latest(self) -> Pose | None:
        pose: Pose | None = self._far.call("pose")
        return pose


class _FarTruth:
    """Ground truth of the twin."""

    def __init__(self, far: _Far) -> None:
        self._far = far

    def now(self) -> TruthSample:
        sample: TruthSample = self._far.call("truth")
        return sample

    def at_exposure(self, seq: int) -> TruthSample:
        sample: TruthSample = self._far.call("exposure", seq)
        return sample
