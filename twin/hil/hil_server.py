"""Server process of a hardware-in-the-loop rig: the twin and an emulated bus.

Servo packets go through a pty. A side channel carries what does not come through the serial line on
a bench: time, pictures, tracker poses, and the truth. In lock-step the twin advances only on
request; otherwise it follows wall-clock time. The process ends when the side channel is closed.
"""

from __future__ import annotations

import select
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from threading import Lock
from typing import Any

from endolock.hw.api import (
    BoardGeometry,
    ConfigError,
    EndolockError,
    Frame,
    Pose,
    TruthSample,
)
from endolock.hw.bench.wall_clock import WallClock
from endolock.hw.camera.picture_stream import PictureStream
from endolock.hw.dynamixel import registers as reg
from endolock.hw.emulator.bus_server import BusServer
from endolock.hw.emulator.emulated_bus import EmulatedBus
from endolock.hw.emulator.line_thread import LineThread
from endolock.hw.emulator.wire_faults import FaultyBus
from endolock.hw.lifecycle import Closing, close_after, close_all
from endolock.twin.camera.renderer import TwinCamera
from endolock.twin.hil.messages import HilSetup, Ready
from endolock.twin.rig import TwinRig

RESTART_S = 0.3
"""Time during which a servo does not answer after a restart, in wall-clock mode [s]. Assumed."""
BEHIND_S = 0.06
"""In wall-clock mode a twin that is behind by more than this leaves out the next picture, as a
camera drops a frame [s]. Assumed: one and a half periods of a camera of 25 Hz."""
AWAY_S = 0.005
"""Polling period while no program has the line open [s]."""


class HilServer(Closing):
    """A twin whose handles are servos on an emulated bus.

    Args:
        setup: its parameters.
    """

    def __init__(self, setup: HilSetup) -> None:
        from endolock.hw.emulator.pty_line import PtyLine  # on Linux only

        self.rig = TwinRig(
            setup.scenario,
            instrument=setup.instrument,
            numerics=setup.numerics,
            seed=setup.seed,
            pictures=setup.pictures,
            overview=setup.overview,
        )
        opened = [self.rig.close]
        try:
            self.rig.clock.sleep_until(0.0)  # takes the first picture, and so tests OpenGL
            now = self.rig.clock.now
            bus = FaultyBus(EmulatedBus(self.rig.servos, now), now, setup.faults, setup.seed)
            self.stream = None if setup.video is None else PictureStream(setup.video)
            if self.stream:
                opened.insert(0, self.stream.close)
            self.line = PtyLine(setup.link)
        except BaseException as error:
            close_after(error, lambda: close_all(*opened))
            raise
        self.emulator = BusServer(bus, self.line, paced=setup.paced)
        self._plugs = [f for f in setup.faults if f.kind == "unplug"]
        for servo in self.rig.servos:
            servo.write(reg.BAUD.address, bytes((reg.BAUDS.index(setup.baud),)))
            servo.reboot_s = RESTART_S if setup.wall else 0.0
        self._shown = -1
        # Held by whoever changes the twin; in wall-clock mode the line has a thread of its own.
        self._turn = Lock()
        self._thread: LineThread | None = None
        self.wall = wall = WallClock() if setup.wall else None
        if wall is not None:
            for servo in self.rig.servos:  # physics advances in steps, a servo's clock does not
                servo.now = lambda: max(now(), wall.now())
            self.rig.late = lambda: wall.now() - now() > BEHIND_S
            self.rig.meanwhile = self._yielding

    def ready(self) -> Ready:
        """Describe the server to its client."""
        rig = self.rig
        return Ready(
            port=self.line.path,
            origin=self.wall.origin if self.wall else None,
            timestep_s=rig.clock.timestep_s,
            calibration=rig.camera.calibration,
            board=rig.board,
            overview=rig.overview.calibration if rig.overview else None,
            tracked=rig.tracker is not None,
            described=rig.describe(),
        )

    def catch_up(self) -> None:
        """Advance the twin to the present wall-clock time; in lock-step do nothing."""
        if self.wall is not None:
            # Not beyond the present time: what is measured must have happened.
            with self._turn:
                self.emulator.answer()  # before a watchdog is found to have expired
                self.rig.clock.sleep_until(self.wall.now() - self.rig.clock.timestep_s)
        if self.stream and (frame := _news(self.rig.camera, self._shown)) is not None:
            self._shown = frame.seq
            assert frame.image is not None
            self.stream.send(frame.image)

    def plug(self) -> None:
        """Plug the line in or out, where that is due."""
        for fault in self._plugs:
            due = self.rig.clock.now()
            if fault.at_s <= due and self.line.plugged:
                self.line.unplug()
            if fault.lasts_s and due >= fault.at_s + fault.lasts_s:
                self.line.plug_in()
                self._plugs.remove(fault)
                return

    def serve(self, channel: Connection | None, until: Callable[[], bool] = lambda: False) -> None:
        """Answer bus and side channel until the channel is closed or `until` is true.

        Args:
            channel: the side channel, if there is one.
            until: called repeatedly; true ends the server.
        """
        if sys.platform == "win32":
            raise ConfigError("the emulated serial line needs Linux", "run it there")
        if self.wall is not None:
            self._serve_wall(channel, until)
            return
        poll, there = select.poll(), -1
        if channel:
            poll.register(channel.fileno(), select.POLLIN)
        while not until():
            self.catch_up()
            self.plug()
            if self.line.fileno() != there:  # plugged in again
                if there >= 0:
                    poll.unregister(there)
                there = self.line.fileno()
                if there >= 0:
                    poll.register(there, select.POLLIN)
            found = dict(poll.poll())
            flags = found.get(there, 0)
            if flags & select.POLLIN:
                self.emulator.answer()
            elif flags and len(found) == 1:  # not open anywhere, and opening it is no event
                time.sleep(AWAY_S)
            if channel and channel.fileno() in found and not self._answer(channel):
                return

    def _serve_wall(self, channel: Connection | None, until: Callable[[], bool]) -> None:
        """Let the twin follow wall-clock time; the line is answered by its own thread."""
        self._thread = LineThread(self.emulator, self._turn, self.plug)
        step_s = self.rig.clock.timestep_s
        while not until():
            self._thread.check()
            self.catch_up()
            if channel is None:
                time.sleep(step_s)
            elif channel.poll(step_s) and not self._answer(channel):
                return

    def _answer(self, channel: Connection) -> bool:
        """Answer one call on the side channel; return whether its other end is still there."""
        self.catch_up()
        try:
            name, args = channel.recv()
        except (EOFError, ConnectionError):
            return False
        with self._turn:
            answer = self._call(name, args)
        channel.send(answer)
        return True

    @contextmanager
    def _yielding(self) -> Iterator[None]:
        """Let the line be answered meanwhile."""
        self._turn.release()
        try:
            yield
        finally:
            self._turn.acquire()

    def close(self) -> None:
        """Release all resources; may be called twice."""
        first = [part.close for part in (self._thread, self.stream) if part is not None]
        close_all(*first, self.line.close, self.rig.close)

    def _call(self, name: str, args: tuple[Any, ...]) -> tuple[str, Any]:
        try:
            return "done", getattr(self, f"on_{name}")(*args)
        except (EndolockError, LookupError) as error:
            return "error", error
        except ValueError as error:
            return "error", ConfigError(str(error))

    def on_sleep(self, t: float) -> float:
        """Advance to a time [s]; return the time reached."""
        return self.rig.clock.sleep_until(t)

    def on_frame(self, newest: int) -> Frame | None:
        """Return the newest frame, None if its number is `newest`."""
        return _news(self.rig.camera, newest)

    def on_overview(self, newest: int) -> Frame | None:
        """Return the newest frame of the fixed camera, None if its number is `newest`."""
        return _news(self.rig.overview, newest) if self.rig.overview else None

    def on_pose(self) -> Pose | None:
        """Return the newest pose of the tracker."""
        return self.rig.tracker.latest() if self.rig.tracker else None

    def on_truth(self) -> TruthSample:
        """Return the truth at the present time."""
        return self.rig.truth.now()

    def on_exposure(self, seq: int) -> TruthSample:
        """Return the truth at the exposure of a frame."""
        return self.rig.truth.at_exposure(seq)

    def on_aim(self, pixel: tuple[float, float]) -> BoardGeometry:
        """Make the point of the board that is seen at a pixel the target; return the board."""
        self.rig.aim(pixel)
        return self.rig.board


def _news(camera: TwinCamera, newest: int) -> Frame | None:
    frame = camera.latest()
    return None if frame is None or frame.seq == newest else frame


def main(descriptor: int) -> int:
    """Serve the client at the other end of a socket; return the exit code."""
    channel = Connection(descriptor)
    try:
        server = HilServer(channel.recv())
    except ConfigError as error:
        channel.send(("error", error))
        return 2
    with server, suppress(BrokenPipeError):  # where the client was killed
        channel.send(("done", server.ready()))
        server.serve(channel)
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
