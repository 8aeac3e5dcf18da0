"""A real bench as a rig: two servos on a serial bus, and a camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from endolock.hw import boards
from endolock.hw.api import ConfigError
from endolock.hw.bench import bench_file
from endolock.hw.bench.bench_file import Bench
from endolock.hw.bench.wall_clock import WallClock
from endolock.hw.camera.absent_camera import AbsentCamera
from endolock.hw.camera.video_camera import VideoCamera
from endolock.hw.dynamixel.port import BITS, serial_port
from endolock.hw.dynamixel.servo_bus import CYCLE_BYTES, TIMEOUT_S, Bus
from endolock.hw.dynamixel.servo_drive import ServoDrive
from endolock.hw.guard import Guard
from endolock.hw.lifecycle import ClosingRig, close_all


class SerialRig(ClosingRig):
    """A bench; used like a `TwinRig`, but without ground truth.

    Handles can be driven without a camera: where it gives no picture, `camera` raises its
    ConfigError when it is first needed. Laboratory software, not a medical device; see
    docs/safety.md.

    Args:
        port: serial port; prefer one in /dev/serial/by-id, which stays the same across USB ports.
        bench: its description, or a bench file; bench.toml in this folder if None.
        latency_s: latency of the video chain [s]; that of the bench if None.

    Raises:
        ConfigError: the bench file, or the calibration that it names, cannot be used.
    """

    overview = None
    tracker = None
    truth = None

    def __init__(
        self,
        port: str | Path,
        bench: Bench | Path | None = None,
        *,
        latency_s: float | None = None,
    ) -> None:
        self.bench = made = bench if isinstance(bench, Bench) else bench_file.load(bench)
        self.clock = WallClock()
        names = {handle.id: axis for axis, handle in made.handles.items()}
        timeout_s = TIMEOUT_S + BITS * CYCLE_BYTES / made.baud
        self.line = Bus(serial_port(port, made.baud), self.clock, names, timeout_s)
        self.drive = ServoDrive(self.line, self.clock, made.handles)
        self.actuators: Guard = Guard(self.drive)
        self.board = boards.all_boards()[made.board].geometry
        self.latency_s = made.camera.latency_s if latency_s is None else latency_s
        """Capture to delivery of the video [s]."""
        self._geometry = made.camera.geometry()
        self.camera: VideoCamera | AbsentCamera
        try:
            self.camera = VideoCamera(
                made.camera.source,
                self._geometry,
                self.clock,
                latency_s=self.latency_s,
                frame_rate_hz=made.camera.frame_rate_hz,
                timeout_s=made.camera.video_timeout_s,
            )
        except ConfigError as error:
            self.camera = AbsentCamera(error)

    def describe(self) -> Mapping[str, Any]:
        """Return bench, camera, board and line as plain values."""
        return {
            "bench": self.bench.model_dump(mode="json"),
            "calibration": asdict(self._geometry),
            "board": asdict(self.board),
            "line": self.drive.describe(),
        }

    def close(self) -> None:
        """Switch the handles off, close port and camera; may be called twice."""
        close_all(self.actuators.close, self.line.close, self.camera.close)
