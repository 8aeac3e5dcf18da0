"""The twin's cameras: EGL pictures, and the video chain that delivers them late.

A frame exposed at t is delivered at t + latency (+ jitter). The camera's estimate of the exposure
time, `Frame.t_capture`, is the delivery time minus the nominal latency, as on a bench.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import AbstractContextManager, nullcontext
from math import ceil

import mujoco

import endolock
from endolock.hw.api import Calibration, Clock, ConfigError, Frame, Image
from endolock.hw.frozen import read_only
from endolock.twin.camera import forks, optics
from endolock.twin.randomness import generator
from endolock.twin.world import mid_run
from endolock.twin.world.mid_run import Change, VideoGap
from endolock.twin.world.scenario import Scenario

Picture = Image | Future[Image] | None
"""A picture, one that is still being developed, or none."""


class Renderer:
    """Renders the view of a camera of the model, with the effects that cost time switched off.

    The OpenGL context is created with the first picture, in the thread that draws it.

    Args:
        model: the compiled scene.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._renderers: dict[tuple[int, int], mujoco.Renderer] = {}
        self._thread: int | None = None
        self._closed = False
        self.meanwhile: Callable[[], AbstractContextManager[None]] = nullcontext
        """Entered while a picture is drawn, which does not use the state."""
        self._option = mujoco.MjvOption()
        self._option.tendongroup[:] = 0  # hidden in the rings, and a third of the drawing time
        self._option.sitegroup[:] = 0

    def draw(self, data: mujoco.MjData, camera: int, width: int, height: int) -> Image:
        """Draw one picture, RGB; positions of bodies, cameras and lights must be current.

        Raises:
            ConfigError: off-screen rendering is not available, the renderer is closed, the first
                picture was drawn in another thread, or this process was forked from one that
                rendered.
        """
        if self._closed:
            raise ConfigError("this rig is closed and takes no pictures", "make a new one")
        if self._thread not in (None, threading.get_ident()):
            raise ConfigError(
                "pictures were drawn in another thread before",
                "sleep on the clock of a rig in one thread only",
            )
        self._thread = threading.get_ident()
        forks.check_first_use()
        renderer = self._renderers.get((width, height))
        if renderer is None:
            renderer = self._renderers[width, height] = self._make(width, height)
        renderer.update_scene(data, camera, self._option)
        with self.meanwhile():
            picture: Image = renderer.render()
        return picture

    def close(self) -> None:
        """Release the OpenGL contexts."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()
        self._closed = True

    def _make(self, width: int, height: int) -> mujoco.Renderer:
        try:
            renderer = mujoco.Renderer(self._model, height, width)
        except Exception as error:  # depends on the OpenGL platform in use
            said = " ".join(str(error).split()) or type(error).__name__
            raise ConfigError(
                f"cannot render a picture off-screen with MUJOCO_GL={endolock.opengl()} ({said})",
                "install EGL (Debian and Ubuntu: apt install libegl1 libgl1), leave MUJOCO_GL "
                "unset, import endolock before mujoco, or use --vision truth",
            ) from error
        renderer.scene.flags[:] = 0
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = 1
        return renderer


class TwinCamera:
    """A camera whose frames arrive late, sometimes irregularly, sometimes never.

    Args:
        calibration: its geometry.
        clock: decides which frames have arrived.
        seed: seed of jitter, drops and repeats.
        latency_s: exposure to delivery [s].
        jitter_s: half width of the uniform variation of the latency [s].
        drop_fraction: share of the frames that never arrive [1].
        repeat_fraction: share of the frames that arrive as a copy of the previous one [1].
        nominal_latency_s: latency from which `t_capture` is computed [s]; the true one if None.
        changes: changes of these values, except of repeats, in the order in which they start.
        gaps: times in which no frame arrives.
    """

    def __init__(
        self,
        calibration: Calibration,
        clock: Clock,
        seed: int,
        *,
        latency_s: float = 0.0,
        jitter_s: float = 0.0,
        drop_fraction: float = 0.0,
        repeat_fraction: float = 0.0,
        nominal_latency_s: float | None = None,
        changes: Sequence[Change] = (),
        gaps: Sequence[VideoGap] = (),
    ) -> None:
        self._calibration, self._clock = calibration, clock
        self._at_first = {
            "latency_s": latency_s,
            "nominal_latency_s": latency_s if nominal_latency_s is None else nominal_latency_s,
            "jitter_s": jitter_s,
            "drop_fraction": drop_fraction,
        }
        self._changes, self._gaps = changes, gaps
        self._jitter = generator(seed, "camera.jitter")
        self._drops = generator(seed, "camera.drops")
        self._repeats, self._repeat_fraction = generator(seed, "camera.repeats"), repeat_fraction
        self._line: deque[tuple[float, float, int, Picture, bool]] = deque()
        self._sent: Picture = None
        self._newest: Frame | None = None
        self._last_available = self._believed_s = 0.0

    @property
    def calibration(self) -> Calibration:
        """Its geometry."""
        return self._calibration

    def delivery(self, t: float) -> float | None:
        """Draw the delivery time of the frame exposed at `t` [s]; None if it is dropped."""
        varied = self._value("jitter_s", t) * self._jitter.uniform(-1.0, 1.0)
        late = self._value("latency_s", t) + varied
        if self._drops.random() < self._value("drop_fraction", t):
            return None
        # A video chain delivers in order.
        available = max(t + late, t, self._last_available)
        if any(gap.holds(available) for gap in self._gaps):
            return None
        self._last_available = available
        self._believed_s = self._value("nominal_latency_s", t)
        return available

    def send(self, seq: int, available: float, image: Picture) -> None:
        """Send a picture that arrives at `available` [s]."""
        repeated = seq > 0 and self._repeats.random() < self._repeat_fraction
        self._sent = self._sent if repeated else image
        self._line.append((available, available - self._believed_s, seq, self._sent, repeated))

    def latest(self) -> Frame | None:
        """Return the newest frame delivered so far, None before the first."""
        now = self._clock.now() + 1e-9
        arrived = None
        while self._line and self._line[0][0] <= now:
            arrived = self._line.popleft()
        if arrived:
            available, t_capture, seq, image, repeated = arrived
            self._newest = Frame(
                image=read_only(image.result() if isinstance(image, Future) else image),
                t_capture=t_capture,
                t_available=available,
                seq=seq,
                dropped=seq - 1 - (self._newest.seq if self._newest else -1),
                repeated=repeated,
            )
        return self._newest

    def _value(self, name: str, t: float) -> float:
        """Return a setting at a time [s]."""
        return mid_run.value_at(self._changes, name, self._at_first[name], t)


def tip_camera(scenario: Scenario, clock: Clock, seed: int) -> TwinCamera:
    """Make the tip camera of a scenario."""
    video = scenario.camera
    return TwinCamera(
        optics.calibration(video),
        clock,
        seed,
        latency_s=video.latency_s,
        jitter_s=video.jitter_s,
        drop_fraction=video.drop_fraction,
        repeat_fraction=video.repeat_fraction,
        nominal_latency_s=video.nominal_latency_s,
        changes=mid_run.in_order(scenario.change),
        gaps=scenario.video_gap,
    )


def under_way(scenario: Scenario) -> int:
    """Return how many frames to remember: those under way at once, and one second of others."""
    video, changes = scenario.camera, scenario.change
    latency_s = mid_run.largest(changes, "latency_s", video.latency_s)
    jitter_s = mid_run.largest(changes, "jitter_s", video.jitter_s)
    return ceil((latency_s + jitter_s + 1.0) * video.frame_rate_hz)
