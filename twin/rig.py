"""The whole twin as a rig: clock, guarded handles, late camera, pose tracker, truth.

The physics advances only while a caller sleeps on the clock. Exposures, pose measurements and
friction updates happen at fixed points of the physics grid, so the results are bit-identical
however a sleep is divided.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import asdict, replace
from math import floor, inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np

from endolock.hw import boards
from endolock.hw.api import ConfigError, Image
from endolock.hw.dynamixel.servo_drive import ServoDrive
from endolock.hw.emulator.direct_link import DirectLink
from endolock.hw.guard import Guard
from endolock.hw.lifecycle import ClosingRig, close_all
from endolock.twin.arguments import CLOSED, parameters, seed_of
from endolock.twin.camera import exposure, optics, renderer
from endolock.twin.camera.exposure import SubExposure
from endolock.twin.ground_truth import TwinTruth
from endolock.twin.model import scene
from endolock.twin.physics import motor
from endolock.twin.physics.plant import TwinPlant
from endolock.twin.pose_tracker import TwinPoseTracker
from endolock.twin.simulated_clock import SimulatedClock
from endolock.twin.world.instrument import Instrument, Numerics
from endolock.twin.world.scenario import Scenario, load
from endolock.vision import camera_model

OVERVIEW_SIZE = (480, 360)
OVERVIEW_EVERY = 2
"""Width and height of the fixed camera's pictures [px], and one picture for every `OVERVIEW_EVERY`
of the tip camera. They are for viewing only."""
SHARP_PX = 1.0
"""Largest motion during an exposure for which a picture is drawn only once [px]; the average of
several would differ by a fraction of a pixel. Assumed."""


class TwinRig(ClosingRig):
    """A simulated endoscope with the interface of a real one.

    Args:
        scenario: name, TOML file or loaded scenario.
        instrument: parameters of the endoscope; `pretensioned` if None.
        numerics: resolution of the simulation; the defaults if None.
        seed: seed of all random numbers, >= 0.
        pictures: whether frames carry pictures; if not, vision must use the truth.
        overview: whether the fixed camera takes pictures too.

    Raises:
        ConfigError: the scenario, an object or the seed cannot be used.
    """

    line = None
    _closed = False

    def __init__(
        self,
        scenario: str | Path | Scenario = "straight",
        *,
        instrument: Instrument | None = None,
        numerics: Numerics | None = None,
        seed: int = 0,
        pictures: bool = True,
        overview: bool = False,
    ) -> None:
        self.seed = seed = seed_of(seed)
        instrument = parameters(Instrument, instrument)
        self._numerics = parameters(Numerics, numerics)
        self.scenario, self.pictures = load(scenario), pictures
        self.board = boards.aimed(self.scenario.board.kind, self.scenario.board.target)
        self.plant = TwinPlant(self.scenario, instrument, self._numerics, seed)
        self.clock = SimulatedClock(self.plant, self.plant.timestep_s, self.advance)
        self.servos = motor.servos(self.plant, self.clock.now)
        self.instrument = made = self.plant.instrument
        link = DirectLink(self.servos, self.clock)
        drive = ServoDrive(link, self.clock, motor.handles(made), motor.units(made))
        self.actuators: Guard = Guard(drive)
        self.tracker: TwinPoseTracker | None = None
        if self.scenario.tracker:
            self.tracker = TwinPoseTracker(self.scenario.tracker, self.plant, self.clock, seed)

        video = self.scenario.camera
        model = self.plant.model
        calibration = optics.calibration(video)
        self._tip, self._fixed = (scene.camera_id(model, name) for name in ("tip", "overview"))
        self.camera = renderer.tip_camera(self.scenario, self.clock, seed)
        self.overview: renderer.TwinCamera | None = None
        if overview and pictures:
            fixed = camera_model.from_fovy(*OVERVIEW_SIZE, scene.OVERVIEW_FOVY_DEG)
            self.overview = renderer.TwinCamera(fixed, self.clock, seed)
        under_way = renderer.under_way(self.scenario)
        self.truth = TwinTruth(self.plant, calibration, self.board, under_way)
        self._renderer = renderer.Renderer(model)
        self._optics = optics.Optics(video, seed) if pictures else None
        self._shot = optics.shot(video)
        self.late: Callable[[], bool] = bool
        """Whether a picture that is due is to be left out, to keep up with wall-clock time."""
        self._left_out = False
        self._available: float | None = None
        self._pictures: list[Image] = []
        self._blurred = False
        self._darkroom = ThreadPoolExecutor(1)  # one worker, so that the order of noise is fixed
        self._shutter = exposure.sub_exposures(video, self.clock.timestep_s, pictures=pictures)
        self._moment = next(self._shutter)

    @property
    def meanwhile(self) -> Callable[[], AbstractContextManager[None]]:
        """Entered while a picture is drawn: the twin does not change, and others may use it."""
        return self._renderer.meanwhile

    @meanwhile.setter
    def meanwhile(self, enter: Callable[[], AbstractContextManager[None]]) -> None:
        self._renderer.meanwhile = enter

    def advance(self, step: int) -> None:
        """Advance the physics to a grid point, exposing frames and measuring poses on the way."""
        if self._closed:
            raise ConfigError(*CLOSED)
        self._look()
        while self.plant.step_count < step:
            due = min(self._moment.step, self._watchdog_step())
            if self.tracker:
                due = min(due, self.tracker.due_step())
            self.plant.advance(int(min(step, due)))
            self._look()

    def describe(self) -> Mapping[str, Any]:
        """Return scenario, instrument, numerics, camera and board as plain values."""
        return {
            "scenario": self.scenario.model_dump(),
            "instrument": asdict(self.plant.instrument),
            "numerics": asdict(self._numerics),
            "calibration": asdict(self.camera.calibration),
            "board": asdict(self.board),
        }

    def aim(self, pixel: tuple[float, float]) -> None:
        """Make the point of the board that is now seen at a pixel the target.

        Raises:
            ConfigError: there is no board at that pixel.
        """
        plant = self.truth.now().plant
        rotation = plant.tip.matrix
        board = self.plant.base_from_board
        # In board axes: position of the camera, and direction of the ray.
        start = board.T @ np.subtract(plant.tip.position, plant.board.position)
        ray = board.T @ rotation @ camera_model.ray(self.camera.calibration, pixel)
        x, y, _ = (start - start[2] / ray[2] * ray).tolist() if ray[2] > 0 else (inf, inf, 0)
        if not max(abs(x), abs(y)) <= self.board.size_m / 2:
            u, v = pixel
            raise ConfigError(f"no board at pixel {u:g},{v:g}", "select a part of it")
        self.board = replace(self.board, target=(x, y))
        self.truth.target = (x, y, 0.0)

    def draw(self, camera: str | int, width: int, height: int) -> Image:
        """Draw what a camera of the model sees now, with neither latency nor lens nor noise.

        Args:
            camera: name or number of the camera: tip or overview.
            width: width [px].
            height: height [px].

        Raises:
            ConfigError: there is no such camera, the picture is too large, or pictures cannot be
                rendered here.
        """
        model = self.plant.model
        index = scene.camera_id(model, camera) if isinstance(camera, str) else camera
        if not 0 <= index < model.ncam:
            raise ConfigError(f"camera {camera}", f"use tip, overview, or 0 to {model.ncam - 1}")
        largest = model.vis.global_.offwidth, model.vis.global_.offheight
        if not (0 < width <= largest[0] and 0 < height <= largest[1]):
            raise ConfigError(
                f"a picture of {width}x{height} px", f"use at most {largest[0]}x{largest[1]}"
            )
        self.plant.draw_board()
        return self._renderer.draw(self.plant.data, index, width, height)

    def close(self) -> None:
        """Switch the handles off and release the OpenGL context; may be called twice."""
        close_all(
            self.actuators.close,
            self._darkroom.shutdown,
            self._renderer.close,
            self.clock.stop,
        )
        self._closed = True

    def _look(self) -> None:
        """Expose and measure what is due at this step."""
        while self.plant.step_count >= self._moment.step:
            self._expose(self._moment)
            self._moment = next(self._shutter)
        while self.tracker and self.plant.step_count >= self.tracker.due_step():
            self.tracker.measure()
        for servo in self.servos:
            servo.watch()

    def _watchdog_step(self) -> float:
        """Return the first grid point after the watchdog of a servo has expired."""
        trips_at = min(servo.trips_at for servo in self.servos)
        return floor(trips_at / self.clock.timestep_s + 1e-6) + 1 if isfinite(trips_at) else inf

    def _expose(self, moment: SubExposure) -> None:
        seq, t = moment.seq, self.plant.t
        if moment.first:
            self._left_out = self.pictures and self.late()
        if moment.nominal:
            self.truth.expose(seq)
            self._available = self.camera.delivery(t)
            if self.overview and seq % OVERVIEW_EVERY == 0 and not self._left_out:
                self.plant.draw_board()
                fixed = self._renderer.draw(self.plant.data, self._fixed, *OVERVIEW_SIZE)
                self.overview.send(seq, t, fixed)
        if moment.first and not moment.last:
            video = self.scenario.camera
            moved = self.plant.seen_speed() * video.exposure_s * self.camera.calibration.focal_px
            self._blurred = moved > SHARP_PX
        if self.pictures and not self._left_out and (moment.nominal or self._blurred):
            self.plant.draw_board()
            size = self._shot.width, self._shot.height
            self._pictures.append(self._renderer.draw(self.plant.data, self._tip, *size))
        if not moment.last:
            return
        taken, self._pictures = self._pictures, []
        if self._available is not None and not self._left_out:
            image = self._darkroom.submit(self._optics.develop, taken) if self._optics else None
            self.camera.send(seq, max(self._available, t), image)
