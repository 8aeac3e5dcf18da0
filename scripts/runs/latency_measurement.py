"""Measures the latency of the video on any rig with a camera, from handle and image motion.

One handle moves back and forth; its speed is modulated but never changes sign within a stroke. The
camera looks at a textured scene at rest.

print(LatencyMeasurement(latency_s=0.33).run().latency_s)
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

from endolock.control import loop
from endolock.control.identification import latency_estimate
from endolock.hw.api import AXES, Command, ConfigError
from endolock.scripts.runs import rigs
from endolock.scripts.runs.progress import progress
from endolock.scripts.runs.stopping import closing
from endolock.twin.world import instrument_files
from endolock.twin.world import scenario as scenarios
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.scenario import Scenario
from endolock.vision.ego_motion import EgoMotion
from endolock.vision.observation import Turn

STROKE_S = 6.0
SPEED_RAD_S = 0.30
MODULATION = ((0.9, 0.35), (1.7, 0.30), (2.9, 0.25))
"""Frequency [Hz] and share of the speed; the sum is below 1, so the handle never reverses."""
MOST = 0.9
"""Least number of rotations measured beside a board, of those measured anywhere in the picture [1],
for the former to be used: a board is nearer than the wall, and the two turn differently."""
LEAD_S = 1.0
"""Duration of the slow start [s]."""


@dataclass(frozen=True, kw_only=True)
class LatencyRecord:
    """A measured latency, as the JSON of `endolock latency` holds it."""

    latency_s: float
    """Exposure to delivery of a frame, including the lag of tip and handle [s]."""
    jitter_s: float
    """Standard deviation of the delivery times from a constant rate [s]."""
    frame_rate_hz: float
    """Rate of the frames [Hz]."""
    ci95_s: tuple[float, float]
    """95 % confidence interval of the latency [s]."""
    correlation: float
    """Correlation of handle motion and image motion at this latency [1]."""
    vision_ms: float
    """Median time of vision for a frame, markers and rotation, not part of the latency [ms]."""
    frames: int
    """Number of frames."""
    rig: str
    """Rig that was driven."""
    scenario: str
    """Name of the scenario."""
    axis: str
    """Handle that turned."""
    seed: int
    """Seed of all random numbers."""


@dataclass(frozen=True, kw_only=True)
class LatencyMeasurement:
    """Strokes of one handle in front of a scene at rest."""

    rig: str = "twin"
    """Name of a rig that takes pictures, see `rigs.RIGS`, or serial:PORT."""
    bench: Path | None = None
    """With serial: TOML file of the bench; bench.toml in the current folder if None."""
    scenario: str | Path | Scenario = "rest"
    """Name, TOML file, or a loaded scenario; it must be at rest."""
    axis: str = "left_right"
    """Handle that turns: up_down or left_right."""
    instrument: str | Path | Instrument = "pretensioned"
    """Name, TOML file, or an instrument."""
    latency_s: float | None = None
    """Latency of the twin's video, unknown to the measurement [s]; the scenario's if None."""
    jitter_s: float | None = None
    """Jitter of the twin's latency, +- [s]; the scenario's if None."""
    strokes: int = 8
    """Number of strokes, 4 or more."""
    seed: int = 0
    """Seed of all random numbers."""

    def run(self, *, show_progress: bool = False) -> LatencyRecord:
        """Move the handle and correlate its motion with that of the picture.

        Args:
            show_progress: whether to show a progress bar.

        Raises:
            ConfigError: it cannot be measured, or the pictures show no motion.
            HardwareError: the handles stopped.
        """
        if self.axis not in AXES:
            raise ConfigError(f"axis '{self.axis}' is unknown", f"use {' or '.join(AXES)}")
        if self.strokes < 4:
            raise ConfigError(f"strokes {self.strokes}: an interval needs 4 or more")
        rigs.check(self.rig, "markers")
        options = {"camera.latency_s": self.latency_s, "camera.jitter_s": self.jitter_s}
        overrides = {key: value for key, value in options.items() if value is not None}
        scenario = scenarios.load(self.scenario, overrides)
        rig, eyes = rigs.make(
            self.rig,
            scenario,
            vision="markers",
            instrument=instrument_files.load(self.instrument),
            seed=self.seed,
            bench=rigs.bench_of(self.rig, self.bench),
        )
        axis = AXES.index(self.axis)
        duration_s = LEAD_S + self.strokes * STROKE_S + latency_estimate.LONGEST_S
        turning = EgoMotion(rig.camera.calibration)
        times, handles = [], []
        frames: list[tuple[float, int, float, float]] = []
        taken: list[float] = []
        newest = -1
        with closing() as stop, rig, progress("latency", duration_s, show_progress, stop) as report:
            rig.actuators.enable()
            command: Command | None = None
            start = rig.clock.now()
            for t, _ in loop.ticks(rig.clock, loop.PERIOD_S, start + duration_s):
                state = rig.actuators.exchange(command)
                times.append(state.t)
                handles.append(state.position[axis])
                frame = rig.camera.latest()
                if frame is not None and frame.seq > newest:
                    newest = frame.seq
                    began_s = time.perf_counter()
                    beside = eyes(frame).turn
                    taken.append(time.perf_counter() - began_s)
                    turns = (_part(beside, axis), _part(turning(frame), axis))
                    frames.append((frame.t_available, frame.seq, *turns))
                if command is None:
                    goal = list(state.position)
                    began = goal[axis]
                # Start at the present angle, without a step.
                left = max(0.0, 1.0 - (t - start) / LEAD_S)
                goal[axis] = stroke_angle(t - start, self.strokes) + began * left
                command = Command(position=goal)
                report(t)
        delivered, seq, beside_board, anywhere = np.array(frames).T
        # Where no board is seen, everything is at rest.
        with_board = np.isfinite(beside_board).mean() > MOST * np.isfinite(anywhere).mean()
        rotation = beside_board if with_board else anywhere
        motion = latency_estimate.strokes(np.array(times), np.array(handles))
        found = latency_estimate.measure(motion, delivered, seq, rotation[1:])
        if isinstance(found, str):
            raise ConfigError(f"no latency measured: {found}")
        return LatencyRecord(
            latency_s=found.latency_s,
            jitter_s=found.jitter_s,
            frame_rate_hz=found.frame_rate_hz,
            ci95_s=found.ci95_s,
            correlation=found.correlation,
            vision_ms=1e3 * median(taken),
            frames=len(frames),
            rig=self.rig,
            scenario=scenario.name,
            axis=self.axis,
            seed=self.seed,
        )


def stroke_angle(t: float, count: int) -> float:
    """Goal of the handle at time `t` [rad]: strokes from end to end with modulated speed."""
    half = SPEED_RAD_S * STROKE_S / 2
    since = t - LEAD_S
    if since <= 0:
        return -half * max(0.0, t / LEAD_S)
    number, phase = divmod(min(since, count * STROKE_S), STROKE_S)
    travelled = SPEED_RAD_S * (phase + sum(_swing(f, a, phase) for f, a in MODULATION))
    end = SPEED_RAD_S * (STROKE_S + sum(_swing(f, a, STROKE_S) for f, a in MODULATION))
    angle = 2 * half * travelled / end - half
    return float(angle if number % 2 == 0 else -angle)


def _swing(frequency_hz: float, share: float, t: float) -> float:
    """Integral of share sin(2 pi f t) [s]."""
    w = 2 * np.pi * frequency_hz
    return float(share * (1 - np.cos(w * t)) / w)


def _part(turn: Turn | str | None, axis: int) -> float:
    """Rotation of the camera about the handle's axis [rad]; NaN without."""
    return turn.vector[axis] if isinstance(turn, Turn) else float("nan")
