"""The whole twin as a rig: clock, guarded handles, late camera, pose tracker, truth.

Physics moves only while somebody sleeps on the clock. Exposures, tracking and friction renewals
stand at fixed points of the physics grid, so cutting a sleep into pieces changes no bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from math import ceil
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from endolock.hw.api import BoardGeometry, ConfigError
from endolock.hw.guard import Guard
from endolock.twin import board as boards
from endolock.twin import camera, scenario
from endolock.twin.drive import TwinDrive
from endolock.twin.instrument import Instrument, Numerics
from endolock.twin.plant import TwinPlant
from endolock.twin.scenario import Scenario
from endolock.twin.tracker import TwinTracker
from endolock.twin.truth import TwinTruth

OVERVIEW_SIZE = (480, 360)
OVERVIEW_EVERY = 2
"""Pictures of the fixed camera, width and height [px], one for so many of the tip camera's: for
people, so a quarter of the price will do."""


class TwinClock:
    """Simulated time: sleeping on it makes the twin move.

    Args:
        rig: is told to advance.
        timestep_s: its grid [s].
    """

    realtime = False

    def __init__(self, rig: TwinRig, timestep_s: float) -> None:
        self._rig, self.timestep_s = rig, timestep_s

    def now(self) -> float:
        """Time since the rig was made [s]."""
        return self._rig.plant.t

    def sleep_until(self, t: float) -> float:
        """Advance to the first grid point at or after `t` [s] and return its time."""
        self._rig.advance(ceil(t / self.timestep_s - 1e-6))
        return self.now()


class TwinRig:
    """A simulated endoscope that steers like a real one.

    Args:
        scenario: name, TOML file or loaded scenario.
        instrument: what the endoscope is made of; `pretensioned` if None.
        numerics: how finely it is simulated; the defaults if None.
        seed: of every random number, >= 0.
        pictures: whether frames carry pictures; without, vision must take the truth.
        overview: whether the fixed camera takes pictures too.

    Raises:
        ConfigError: the scenario cannot be used.
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
    ) -> None:
        if seed < 0:
            raise ConfigError(f"seed {seed}; use a whole number, 0 or more")
        self.scenario = load(scenario)
        self.board: BoardGeometry = boards.standard()
        self._numerics = numerics or Numerics()
        self.plant = TwinPlant(self.scenario, instrument or Instrument(), self._numerics, seed)
        self.clock = TwinClock(self, self.plant.timestep_s)
        self.actuators = Guard(TwinDrive(self.plant, self.clock))
        self.tracker: TwinTracker | None = None
        if self.scenario.tracker:
            self.tracker = TwinTracker(self.scenario.tracker, self.plant, self.clock, seed)

        video = self.scenario.camera
        size = video.width, video.height
        model = self.plant.model
        self._tip, calibration = camera.of_model(model, "tip", *size)
        self.camera = camera.TwinCamera(
            calibration,
            self.clock,
            seed,
            latency_s=video.latency_s,
            jitter_s=video.jitter_s,
            drop_fraction=video.drop_fraction,
        )
        self._fixed, fixed_calibration = camera.of_model(model, "overview", *OVERVIEW_SIZE)
        self.overview: camera.TwinCamera | None = None
        if overview and pictures:
            self.overview = camera.TwinCamera(fixed_calibration, self.clock, seed)
        # Frames under way, and a second more for who asks late.
        under_way = ceil((video.latency_s + video.jitter_s + 1.0) * video.frame_rate_hz)
        self.truth = TwinTruth(self.plant, calibration, self.board, under_way)
        self._renderer = camera.Renderer(model) if pictures else None
        self._exposed = 0

    def advance(self, step: int) -> None:
        """Move the physics up to a grid point, exposing frames and tracking on the way."""
        self._look()
        while self.plant.step_count < step:
            due = self._exposure_step(self._exposed)
            if self.tracker:
                due = min(due, self.tracker.due_step())
            self.plant.advance(min(step, due))
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

    def close(self) -> None:
        """Switch the handles off and give the OpenGL context back; may be called twice."""
        self.actuators.close()
        if self._renderer:
            self._renderer.close()

    def __enter__(self) -> Self:
        """Connect the handles."""
        self.actuators.connect()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close."""
        self.close()

    def _exposure_step(self, seq: int) -> int:
        return round(seq / self.scenario.camera.frame_rate_hz / self.clock.timestep_s)

    def _look(self) -> None:
        """Take what is due at this step."""
        if self.plant.step_count >= self._exposure_step(self._exposed):
            self._expose()
        while self.tracker and self.plant.step_count >= self.tracker.due_step():
            self.tracker.measure()

    def _expose(self) -> None:
        seq, t = self._exposed, self.plant.t
        self._exposed += 1
        self.truth.expose(seq)
        available = self.camera.delivery(t)
        if available is None:
            return
        image = None
        if self._renderer:
            self.plant.draw_board()
            video, data = self.scenario.camera, self.plant.data
            image = self._renderer.draw(data, self._tip, video.width, video.height)
            if self.overview and seq % OVERVIEW_EVERY == 0:
                fixed = self._renderer.draw(data, self._fixed, *OVERVIEW_SIZE)
                self.overview.send(seq, t, fixed)
        self.camera.send(seq, available, image)


def load(source: str | Path | Scenario) -> Scenario:
    """Return a scenario, read first where it is given by name or file."""
    return source if isinstance(source, Scenario) else scenario.load(source)
