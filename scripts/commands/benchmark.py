"""`endolock benchmark`: speed of the parts, as ratios to a bound measured in the same minute.

Machines are shared and noisy: each time is the median of interleaved repetitions, and what counts
is the ratio to bare `mj_step`, to a raw OpenGL quad, or to simulated time.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import cv2
import mujoco
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from endolock.control import loop, registry
from endolock.control.loop import Seen
from endolock.hw.api import Command, Frame
from endolock.scripts.commands import hysteresis, identify, run
from endolock.scripts.runs import output, rigs, run_folder
from endolock.scripts.speed import link_speed, tick_times
from endolock.twin.camera.renderer import Renderer
from endolock.twin.model import scene
from endolock.twin.rig import TwinRig
from endolock.twin.surrogate import SurrogateRig
from endolock.twin.world.instrument import NUMERICS, Instrument, Numerics
from endolock.vision.markers import MarkerEyes
from endolock.vision.track import HALF_PX
from endolock.vision.tracker import Tracker
from endolock.vision.truth import TruthEyes

REPEAT = 7
SLICE_S = 2.0
"""Simulated time of one physics measurement [s]."""
RUN_S = 10.0
"""Simulated time of one pipeline measurement [s]."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Measure the speed of physics, rendering, vision, control, link, logging, protocols and runs.

    With Gymnasium installed (./run test --extra), also that of the environments.
    """

    json: Annotated[tyro.conf.DisallowNone[str | None], tyro.conf.arg(metavar="FILE")] = None
    """Write the figures there as JSON; - prints them, and nothing else, on standard output."""


def main(request: Request) -> int:
    """Carry out `endolock benchmark`; return the exit code."""
    output.check_json(request.json)
    err = Console(stderr=True)
    figures: dict[str, Any] = {}
    with err.status("measuring") as status:
        for name, measure in (
            ("physics", physics),
            ("render", render),
            ("vision", vision),
            ("pipeline", pipeline),
            ("surrogate", surrogate),
            ("control", tick_times.mean),
            ("control_p99", tick_times.p99),
            ("link", link_speed.measure),
            ("log", log),
            ("protocols", protocols),
            ("env", env),
        ):
            if name == "env" and not (find_spec("gymnasium") and find_spec("dm_control")):
                continue
            status.update(f"measuring {name}")
            figures[name] = measure()
    output.write_json(figures, request.json)
    if request.json != "-":
        Console().print(_table(figures))
    return 0


def physics() -> dict[str, Any]:
    """Simulated seconds a second: bare `mj_step` of the model against the clock of the twin."""
    bare_s, wrapped_s = _physics(NUMERICS["default"])
    figures = {
        "real_time_factor": SLICE_S / wrapped_s,
        "bare_real_time_factor": SLICE_S / bare_s,
        "wrapper_over_bare": wrapped_s / bare_s,
        "numerics": "default",
    }
    for name in ("fast", "fidelity"):
        figures[f"{name}_real_time_factor"] = SLICE_S / _physics(NUMERICS[name])[1]
    return figures


def _physics(numerics: Numerics) -> tuple[float, float]:
    """Time for `SLICE_S` of the same slow motion [s]: bare steps, and the whole twin."""
    rig = TwinRig("straight", numerics=numerics, pictures=False)
    plant = rig.plant
    ticks = round(SLICE_S / 0.020)
    per_tick = round(0.020 / plant.timestep_s)
    commands = np.sin(np.linspace(0, 2 * np.pi, ticks))[:, None] * [0.2, 0.4]

    def bare() -> None:
        for command in commands:
            plant.data.ctrl[:] = command
            mujoco.mj_step(plant.model, plant.data, per_tick)

    def wrapped() -> None:
        for command in commands:
            plant.data.ctrl[:] = command
            rig.clock.sleep_until(rig.clock.now() + 0.020)

    with rig:
        rig.actuators.enable()
        bare_s, wrapped_s = _times(bare, wrapped)
    return bare_s, wrapped_s


def render() -> dict[str, Any]:
    """One tip picture of 640x480 px, against a raw textured quad of that size with read-back."""
    with TwinRig("straight", pictures=False) as rig:
        model, data = rig.plant.model, rig.plant.data
        index = scene.camera_id(model, "tip")
        renderer = Renderer(model)
        draw = _raw_quad(640, 480)
        ours, raw = _times(
            lambda: renderer.draw(data, index, 640, 480), draw, repeat=60, warm_up=True
        )
        renderer.close()
    return {"ms_640x480": 1e3 * ours, "over_raw_quad": ours / raw}


def vision() -> dict[str, Any]:
    """One observation of the marker board, and one step of the markerless tracker."""
    frame, eyes = _frame_and_eyes()
    assert frame.image is not None
    grey = np.asarray(cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY), np.uint8)
    tracker = Tracker(grey, eyes(frame).target_px, (HALF_PX, HALF_PX))
    markers_s, tracker_s = _times(
        lambda: eyes(frame), lambda: tracker.step(grey), repeat=60, warm_up=True
    )
    return {"markers_ms": 1e3 * markers_s, "tracker_ms": 1e3 * tracker_s}


def pipeline() -> dict[str, Any]:
    """Runs of `straight` and, with all its optics, `endoscope`: simulated seconds a second.

    The first two write no run folder.
    """
    return {
        "pinhole_rtf": _unlogged("straight"),
        "fisheye_rtf": _unlogged("endoscope"),
        "logged_rtf": _run("markers"),
        "truth_rtf": _run("truth"),
    }


def surrogate() -> dict[str, float]:
    """Simulated seconds a second of the surrogate: behind its rig API, and in the loop, `pi`."""
    plays = rigs.plays_of(Instrument(), 180.0)

    def driven() -> None:
        with SurrogateRig("straight", transmission=plays) as rig:
            rig.actuators.enable()
            for n in range(round(RUN_S / 0.020)):
                rig.clock.sleep_until(0.020 * n)
                rig.actuators.exchange(Command(position=(0.1, 0.001 * n)))
                rig.camera.latest()

    def locked() -> None:
        with SurrogateRig("straight", transmission=plays) as rig:
            law = registry.make("pi", rig.camera.calibration)
            loop.run(rig, TruthEyes(rig.truth), law, duration_s=RUN_S)

    rig_s, loop_s = _times(driven, locked)
    return {"rig_rtf": RUN_S / rig_s, "loop_rtf": RUN_S / loop_s}


def log() -> dict[str, float]:
    """Measure one frame with both pictures on its way into the run folder, and the folder's growth.

    Growth is counted over the frames of a run, without the wait for the first.
    """
    with tempfile.TemporaryDirectory() as name:
        request = run.Request(scenario="straight", duration_s=2.0, out=Path(name) / "run")
        record, path = run.perform(request, show_progress=False)
        if record["interrupted"]:
            raise KeyboardInterrupt
        size = sum(file.stat().st_size for file in path.iterdir())
        seen_s = record["duration_s"] - record["latency_s"]
        with TwinRig("straight", overview=True) as rig:
            rig.clock.sleep_until(0.4)
            frame, eyes = rig.camera.latest(), MarkerEyes(rig.camera.calibration, rig.board)
            assert frame is not None
            assert rig.overview is not None
            seen = Seen(
                frame=frame,
                observation=eyes(frame),
                overview=rig.overview.latest(),
                truth=rig.truth.at_exposure(frame.seq),
            )
        folder = run_folder.RunFolder(Path(name) / "timed", {})
        (taken,) = _times(lambda: folder.seen(seen), repeat=60)
        folder.close()
    return {"ms_per_frame": 1e3 * taken, "mb_per_min": size / 1e6 * 60 / seen_s}


def protocols() -> dict[str, float]:
    """Wall time of `endolock hysteresis` and of `endolock identify` on its log [s]."""
    with tempfile.TemporaryDirectory() as name:
        log_folder = Path(name) / "log"
        measured = hysteresis.perform(hysteresis.Request(out=log_folder), show_progress=False)
        fitted = identify.perform(identify.Request(log=log_folder))
    return {"hysteresis_s": measured["wall_s"], "identify_s": fitted["wall_s"]}


def env() -> dict[str, float]:
    """Steps a second of one Gymnasium environment, and of as many as there are cores, in processes.

    Both see the target without pictures; a step is 20 ms.
    """
    import gymnasium  # an extra

    from endolock.twin.env import gym_env

    count = os.cpu_count() or 1
    single, several = gymnasium.make(gym_env.STATE_ID), gym_env.vector(count)
    actions = np.full((count, 2), 0.1, np.float32)

    def one() -> None:
        for _ in range(100):
            single.step(actions[0])

    def all_of_them() -> None:
        for _ in range(100):
            several.step(actions)

    try:
        single.reset(seed=0)
        several.reset(seed=0)
        one_s, all_s = _times(one, all_of_them)
    finally:
        single.close()
        several.close()
    return {
        "steps_per_s": 100 / one_s,
        "vector_steps_per_s": 100 * count / all_s,
        "environments": count,
    }


def _unlogged(scenario: str) -> float:
    """Pictures, markers and law without a run folder: the loop alone."""
    factors: list[float] = []
    for _ in range(3):
        with TwinRig(scenario) as rig:
            rig.clock.sleep_until(0.0)
            camera = rig.camera.calibration
            eyes, law = MarkerEyes(camera, rig.board), registry.make("pi", camera)
            start = time.perf_counter()
            loop.run(rig, eyes, law, duration_s=RUN_S)
            factors.append(RUN_S / (time.perf_counter() - start))
    return median(factors)


def _run(eyes: str) -> float:
    factors: list[float] = []
    for _ in range(3):
        with tempfile.TemporaryDirectory() as name:
            request = run.Request(
                scenario="straight", vision=eyes, duration_s=RUN_S, out=Path(name) / "run"
            )
            record, _ = run.perform(request, show_progress=False)
            if record["interrupted"]:
                raise KeyboardInterrupt
            factors.append(record["real_time_factor"])
    return median(factors)


def _frame_and_eyes() -> tuple[Frame, MarkerEyes]:
    with TwinRig("straight") as rig:
        rig.clock.sleep_until(0.4)
        frame = rig.camera.latest()
        assert frame is not None
        return frame, MarkerEyes(rig.camera.calibration, rig.board)


def _times(
    *calls: Callable[[], object], repeat: int = REPEAT, warm_up: bool = False
) -> tuple[float, ...]:
    """Median time of each call [s], taken in turns so that a busy moment hits all alike."""
    if warm_up:
        for call in calls:
            call()
    taken: list[list[float]] = [[] for _ in calls]
    for _ in range(repeat):
        for call, times in zip(calls, taken, strict=True):
            start = time.perf_counter()
            call()
            times.append(time.perf_counter() - start)
    return tuple(median(times) for times in taken)


def _raw_quad(width: int, height: int) -> Callable[[], object]:
    """Set up the least that draws a textured picture off-screen and reads it back."""
    context = mujoco.GLContext(width, height)
    context.make_current()
    from OpenGL import GL as gl

    buffers = gl.glGenRenderbuffers(2)
    frame = gl.glGenFramebuffers(1)
    texture = gl.glGenTextures(1)
    image = np.random.default_rng(0).integers(0, 255, (512, 512, 3), np.uint8)

    def bind() -> None:
        context.make_current()
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, frame)

    bind()
    for buffer, kind, place in (
        (buffers[0], gl.GL_RGBA8, gl.GL_COLOR_ATTACHMENT0),
        (buffers[1], gl.GL_DEPTH_COMPONENT24, gl.GL_DEPTH_ATTACHMENT),
    ):
        gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, buffer)
        gl.glRenderbufferStorage(gl.GL_RENDERBUFFER, kind, width, height)
        gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, place, gl.GL_RENDERBUFFER, buffer)
    gl.glBindTexture(gl.GL_TEXTURE_2D, texture)
    gl.glTexParameteri(gl.GL_TEXTURE_2D, gl.GL_TEXTURE_MIN_FILTER, gl.GL_LINEAR)
    gl.glTexImage2D(
        gl.GL_TEXTURE_2D, 0, gl.GL_RGB, 512, 512, 0, gl.GL_RGB, gl.GL_UNSIGNED_BYTE, image
    )
    gl.glEnable(gl.GL_TEXTURE_2D)
    gl.glPixelStorei(gl.GL_PACK_ALIGNMENT, 1)
    out = np.empty((height, width, 3), np.uint8)

    def draw() -> object:
        bind()
        gl.glViewport(0, 0, width, height)
        gl.glClear(gl.GL_COLOR_BUFFER_BIT | gl.GL_DEPTH_BUFFER_BIT)
        gl.glBegin(gl.GL_QUADS)
        for s, t in ((0, 0), (1, 0), (1, 1), (0, 1)):
            gl.glTexCoord2f(s, t)
            gl.glVertex2f(2 * s - 1, 2 * t - 1)
        gl.glEnd()
        gl.glReadPixels(0, 0, width, height, gl.GL_RGB, gl.GL_UNSIGNED_BYTE, out)
        return out

    return draw


def _table(figures: dict[str, Any]) -> Table:
    result = Table(title="endolock benchmark (rtf: simulated seconds a second)")
    for heading in ("part", "figure", "value"):
        result.add_column(heading, justify="right" if heading == "value" else "left")
    for part, values in figures.items():
        for name, value in values.items():
            shown = value if isinstance(value, str) else f"{value:.3g}"
            result.add_row(part, name, shown)
        result.add_section()
    return result
