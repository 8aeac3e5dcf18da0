"""Hardware in the loop: the bench's own drivers, with the twin at the far end of a serial line.

Handles are reached through port, bus and drive as on a bench, from this process; the twin, its
emulated servos and its cameras live in another one. In lock-step a run equals that of `TwinRig` bit
for bit; by the wall it shows what time the line and the programs take.
"""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

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
from endolock.hw.dynamixel.port import BAUD, serial_port
from endolock.hw.dynamixel.servo_bus import TIMEOUT_S, Bus
from endolock.hw.dynamixel.servo_drive import ServoDrive
from endolock.hw.emulator.wire_faults import WireFault
from endolock.hw.guard import Guard
from endolock.hw.lifecycle import ClosingRig, close_all
from endolock.twin.hil.hil_server import Ready, Setup
from endolock.twin.physics import motor
from endolock.twin.world.instrument import Instrument, Numerics
from endolock.twin.world.scenario import Scenario, load

LOCK_STEP_TIMEOUT_S = 2.0
"""Where time stands still while the bus talks, an answer may take as long as a busy machine needs
[s]."""
FAREWELL_S = 10.0
"""The far end gets so long to end [s]."""


class HilRig(ClosingRig):
    """A twin behind a serial line; see `TwinRig`.

    Args:
        scenario: name, TOML file or loaded scenario.
        instrument: what the endoscope is made of; `pretensioned` if None.
        numerics: how finely it is simulated; the defaults if None.
        seed: of every random number, >= 0.
        pictures: whether frames carry pictures; without, vision must take the truth.
        overview: whether the fixed camera takes pictures too.
        wall: whether time is that of the wall; else all wait for each other.
        paced: whether the line is as slow as a wire.
        faults: what goes wrong on it.

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
        if seed < 0:
            raise ConfigError(f"seed {seed}", "use a whole number, 0 or more")
        _need_linux()
        self.scenario = load(scenario)
        made = instrument or Instrument()
        self._far = _Far()
        try:
            ready: Ready = self._far.start(
                Setup(
                    scenario=self.scenario,
                    instrument=made,
                    numerics=numerics or Numerics(),
                    seed=seed,
                    pictures=pictures,
                    overview=overview,
                    wall=wall,
                    paced=paced,
                    baud=BAUD,
                    faults=tuple(faults),
                )
            )
        except BaseException:
            self._far.close()
            raise
        self.clock: Clock = (
            WallClock(ready.origin) if wall else _LockStep(self._far, ready.timestep_s)
        )
        self.board = ready.board
        self._described = ready.described
        handles = motor.handles(made)
        names = {handle.id: axis for axis, handle in handles.items()}
        timeout_s = TIMEOUT_S if wall else LOCK_STEP_TIMEOUT_S
        self.line = Bus(serial_port(ready.port, BAUD), self.clock, names, timeout_s)
        self.drive = ServoDrive(self.line, self.clock, handles, motor.units(made))
        self.actuators: Guard = Guard(self.drive)
        self.camera = _FarCamera(self._far, "frame", ready.calibration)
        self.overview: _FarCamera | None = None
        if ready.overview is not None:
            self.overview = _FarCamera(self._far, "overview", ready.overview)
        self.tracker = _FarTracker(self._far) if ready.tracked else None
        self.truth = _FarTruth(self._far)

    def describe(self) -> Mapping[str, Any]:
        """Return what the twin says of itself, and the line, as plain values."""
        return {**self._described, "line": self.drive.describe()}

    def aim(self, pixel: tuple[float, float]) -> None:
        """Make the point of the board that is seen at a pixel now the target."""
        self.board = self._far.call("aim", pixel)

    def close(self) -> None:
        """Switch the handles off and end the far end; may be called twice."""
        close_all(self.actuators.close, self.line.close, self._far.close)


def _need_linux() -> None:
    """Refuse what has no pseudo-terminals.

    Raises:
        ConfigError: this system is not Linux.
    """
    if sys.platform != "linux":
        raise ConfigError("hardware in the loop needs Linux", "run it there, or use --rig twin")


class _Far:
    """The other process, and the side channel to it."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            theirs.set_inheritable(True)
            command = [sys.executable, "-m", "endolock.twin.hil.hil_server", str(theirs.fileno())]
            # In a session of its own a Ctrl-C stops us, and we stop the handles first.
            self._process = subprocess.Popen(
                command, pass_fds=[theirs.fileno()], start_new_session=True
            )
        self._channel: Connection | None = Connection(ours.detach())

    def start(self, setup: Setup) -> Any:
        """Tell it what to be."""
        return self._exchange(setup)

    def call(self, name: str, *args: Any) -> Any:
        """Ask it for something.

        Raises:
            ConfigError, LookupError: as there.
            HardwareError: it is not there any more.
        """
        return self._exchange((name, args))

    def close(self) -> None:
        """End it; may be called twice."""
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
            raise ConfigError("this rig is closed", "make a new one")
        try:
            self._channel.send(message)
            kind, value = self._channel.recv()
        except (EOFError, ConnectionError):
            raise HardwareError(
                "the emulated bench has ended by itself",
                "read its message above, then start again",
                t=0.0,
            ) from None
        if kind == "error":
            raise value
        return value


class _LockStep:
    """Time of the twin at the far end: sleeping on it makes that move."""

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
    """What the twin knows."""

    def __init__(self, far: _Far) -> None:
        self._far = far

    def now(self) -> TruthSample:
        sample: TruthSample = self._far.call("truth")
        return sample

    def at_exposure(self, seq: int) -> TruthSample:
        sample: TruthSample = self._far.call("exposure", seq)
        return sample
