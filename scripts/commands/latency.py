"""`endolock latency`: latency of the video, from handle motion and image motion.

One handle moves back and forth; its speed is modulated but never changes sign within a stroke. The
camera looks at a textured scene at rest.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import numpy as np
import tyro
from rich.console import Console

from endolock.control import loop
from endolock.control.identification import latency_estimate
from endolock.hw.api import AXES, Command, ConfigError, Frame
from endolock.scripts.runs import output, rigs
from endolock.scripts.runs.progress import progress
from endolock.twin.world import instrument_files
from endolock.twin.world import scenario as scenarios
from endolock.vision.ego_motion import EgoMotion
from endolock.vision.observation import Eyes

STROKE_S = 6.0
SPEED_RAD_S = 0.30
MODULATION = ((0.9, 0.35), (1.7, 0.30), (2.9, 0.25))
"""Frequency [Hz] and share of the speed; the sum is below 1, so the handle never reverses."""
LEAD_S = 1.0
"""Duration of the slow start [s]."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Measure the latency of the video, from exposure to delivery, without the time for vision."""

    rig: str = "twin"
    """Rig to drive: twin, hil, hil:wall, or serial:PORT."""
    bench: tyro.conf.DisallowNone[Path | None] = None
    """With serial: TOML file of the bench; default: bench.toml in the current folder, if there is
    one."""
    scenario: str = "rest"
    """Scenario in front of the camera; it must be at rest."""
    axis: str = "left_right"
    """Handle that turns: up_down or left_right."""
    instrument: str = "pretensioned"
    """Instrument: pretensioned, slack, two_region, thesis, or a TOML file of that form."""
    latency_s: tyro.conf.DisallowNone[float | None] = None
    """Latency of the twin's video, unknown to the measurement [s]; default: the scenario's."""
    jitter_s: tyro.conf.DisallowNone[float | None] = None
    """Jitter of the twin's latency, +- [s]; default: the scenario's."""
    strokes: int = 8
    """Number of strokes, 4 or more."""
    seed: int = 0
    """Seed of all random numbers."""
    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write the result to this file as JSON; - prints only the JSON on standard output."""


def main(request: Request) -> int:
    """Carry out `endolock latency`; return the exit code."""
    output.check_json(request.json)
    record = perform(request)
    output.write_json(record, request.json)
    if request.json != "-":
        low, high = record["ci95_s"]
        console = Console(highlight=False)
        console.print(
            f"latency     {record['latency_s']:.3f} s  (95 % between {low:.3f} and {high:.3f} s)"
        )
        console.print(f"jitter      {1e3 * record['jitter_s']:.1f} ms (standard deviation)")
        console.print(f"frame rate  {record['frame_rate_hz']:.2f} Hz")
        console.print(
            f"vision      {record['vision_ms']:.1f} ms per frame for the markers, not part of the "
            "latency"
        )
    return 0


def perform(request: Request, *, show_progress: bool = True) -> dict[str, Any]:
    """Move the handle and correlate its motion with that of the picture.

    Args:
        request: what to measure.
        show_progress: whether to show a progress bar.

    Raises:
        ConfigError: the request cannot be carried out, or the pictures show no motion.
        HardwareError: the handles stopped.
    """
    if request.axis not in AXES:
        raise ConfigError(f"axis '{request.axis}' is unknown", f"use {' or '.join(AXES)}")
    if request.strokes < 4:
        raise ConfigError(f"strokes {request.strokes}: an interval needs 4 or more")
    rigs.check(request.rig, "markers")
    options = {"camera.latency_s": request.latency_s, "camera.jitter_s": request.jitter_s}
    overrides = {key: value for key, value in options.items() if value is not None}
    scenario = scenarios.load(request.scenario, overrides)
    rig, eyes = rigs.make(
        request.rig,
        scenario,
        vision="markers",
        instrument=instrument_files.load(request.instrument),
        seed=request.seed,
        bench=rigs.bench_of(request.rig, request.bench),
    )
    axis = AXES.index(request.axis)
    duration_s = LEAD_S + request.strokes * STROKE_S + latency_estimate.LONGEST_S
    turning = EgoMotion(rig.camera.calibration)
    times, handles = [], []
    frames: list[tuple[float, int, float]] = []
    taken: list[float] = []
    newest = -1
    with rig, progress("latency", duration_s, show_progress) as report:
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
                frames.append((frame.t_available, frame.seq, _turn(turning, frame, axis)))
                taken.append(_seconds(eyes, frame))
            if command is None:
                goal = list(state.position)
                began = goal[axis]
            # Start at the present angle, without a step.
            left = max(0.0, 1.0 - (t - start) / LEAD_S)
            goal[axis] = stroke_angle(t - start, request.strokes) + began * left
            command = Command(position=goal)
            report(t)
    delivered, seq, rotation = (np.array(column) for column in zip(*frames, strict=True))
    motion = latency_estimate.strokes(np.array(times), np.array(handles))
    found = latency_estimate.measure(motion, delivered, seq, rotation[1:])
    if isinstance(found, str):
        raise ConfigError(f"no latency measured: {found}")
    return {
        "latency_s": found.latency_s,
        "jitter_s": found.jitter_s,
        "frame_rate_hz": found.frame_rate_hz,
        "ci95_s": list(found.ci95_s),
        "correlation": found.correlation,
        "vision_ms": 1e3 * median(taken),
        "frames": len(frames),
        "rig": request.rig,
        "scenario": scenario.name,
        "axis": request.axis,
        "seed": request.seed,
    }


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


def _turn(turning: EgoMotion, frame: Frame, axis: int) -> float:
    """Rotation of the camera about the handle's axis since the previous frame [rad]."""
    turn = turning(frame)
    return float("nan") if isinstance(turn, str) else float(turn.vector[axis])


def _seconds(eyes: Eyes, frame: Frame) -> float:
    start = time.perf_counter()
    eyes(frame)
    return time.perf_counter() - start
