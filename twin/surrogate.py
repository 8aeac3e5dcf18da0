"""A fast replacement for the twin: rate-independent hysteresis, exact kinematics, no physics.

It has the same rig interface, so that controllers can be tried in seconds:

    servos (first-order lag) -> transmission -> constant-curvature section -> projection.

The transmission is weighted plays, both axes alike and independent (control/transmission/plays.py),
or wires with friction, whose loops widen with the bend of both axes
(control/transmission/quasi_static.py): friction as in eq. 3.29 of the thesis with the kinematics of
its controllers, the kind of model that the thesis simulated. It has no pushes, no moving shaft and
no inertia; where the friction changes, the width of its plays does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from endolock.hw import boards
from endolock.hw.api import AXES, ConfigError, Limits
from endolock.hw.drive import Reading
from endolock.hw.guard import Guard
from endolock.hw.lifecycle import ClosingRig, close_all
from endolock.twin.arguments import CLOSED, parameters, seed_of
from endolock.twin.camera import renderer
from endolock.twin.ground_truth import TwinTruth
from endolock.twin.physics.surrogate_plant import TIMESTEP_S, SurrogatePlant, Transmission
from endolock.twin.simulated_clock import SimulatedClock
from endolock.twin.world.fitted_plays import plays_of
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.scenario import Scenario, load


class SurrogateRig(ClosingRig):
    """A rig without pictures; vision must use the truth.

    Args:
        scenario: name, TOML file or loaded scenario, in which only the board moves.
        transmission: from handle angles to bends; plays fitted to the instrument if None.
        instrument: its lengths, handles and encoders are used; the default if None.
        seed: seed of all random numbers, >= 0.

    Raises:
        ConfigError: the scenario has parts that a surrogate does not model, or the instrument or
            the seed cannot be used.
    """

    pictures = False
    overview = None
    tracker = None
    line = None
    _closed = False

    def __init__(
        self,
        scenario: str | Path | Scenario = "straight",
        *,
        transmission: Transmission | None = None,
        instrument: Instrument | None = None,
        seed: int = 0,
    ) -> None:
        self.seed = seed = seed_of(seed)
        self.instrument = made = parameters(Instrument, instrument)
        self.scenario = load(scenario)
        _check(self.scenario)
        transmission = transmission or plays_of(made, self.scenario.shaft_bend_deg)
        self.board = boards.aimed(self.scenario.board.kind, self.scenario.board.target)
        self.plant = SurrogatePlant(self.scenario, transmission, made, seed)
        self.clock = SimulatedClock(self.plant, TIMESTEP_S, self.advance)
        self.actuators: Guard = Guard(SurrogateDrive(self.plant, self.clock, made))
        self.camera = renderer.tip_camera(self.scenario, self.clock, seed)
        under_way = renderer.under_way(self.scenario)
        calibration = self.camera.calibration
        self.truth = TwinTruth(self.plant, calibration, self.board, under_way)
        self._frames = 0
        self._transmission = transmission

    def advance(self, step: int) -> None:
        """Advance to a grid point, exposing frames on the way."""
        if self._closed:
            raise ConfigError(*CLOSED)
        plant, rate = self.plant, self.scenario.camera.frame_rate_hz
        while True:
            due = round(self._frames / rate / TIMESTEP_S)
            plant.advance(min(step, due))
            if plant.step_count < due:
                return
            self.truth.expose(self._frames)
            available = self.camera.delivery(plant.t)
            if available is not None:
                self.camera.send(self._frames, available, None)
            self._frames += 1

    def describe(self) -> Mapping[str, Any]:
        """Return scenario, transmission, camera and board as plain values."""
        return {
            "scenario": self.scenario.model_dump(),
            "transmission": asdict(self._transmission),
            "calibration": asdict(self.camera.calibration),
            "board": asdict(self.board),
        }

    def close(self) -> None:
        """Switch the handles off; may be called twice."""
        close_all(self.actuators.close, self.clock.stop)
        self._closed = True


class SurrogateDrive:
    """The handle motors behind the interface of a drive.

    Args:
        plant: the plant of the handles.
        clock: time of the readings.
        instrument: its range, speed and encoders are used.
    """

    axes: tuple[str, ...] = AXES

    def __init__(
        self, plant: SurrogatePlant, clock: SimulatedClock, instrument: Instrument
    ) -> None:
        self.clock = clock
        self._plant, self._instrument = plant, instrument
        self._zero = (0.0, 0.0)
        self._step = instrument.encoder_step_rad
        self.step_rad = (self._step,) * len(self.axes)
        self._limit()

    def open(self) -> None:
        """Do nothing: it is always available."""

    def transfer(self, goal: tuple[float, ...] | None) -> Reading:
        """Send a goal [rad] if one is given, and measure."""
        plant, (zero_a, zero_b) = self._plant, self._zero
        if goal is not None:
            a, b = self.quantise(goal)
            plant.goal = a + zero_a, b + zero_b
        t = self.clock.now()
        return Reading(
            t=t,
            t_err=0.0,
            position=self.quantise((plant.handles[0] - zero_a, plant.handles[1] - zero_b)),
            velocity=plant.speed,
            current=(0.0, 0.0),
            fresh=True,
            device_tick=round(t * 1000),
        )

    def quantise(self, goal: tuple[float, ...]) -> tuple[float, ...]:
        """Return the nearest encoder position [rad]."""
        return tuple(round(g / self._step) * self._step for g in goal)

    def measure(self) -> Reading:
        """Measure."""
        return self.transfer(None)

    def hold(self, goal: tuple[float | None, ...]) -> None:
        """Hold the handles there; with None one keeps its goal."""
        kept, zero = self._plant.goal, self._zero
        a, b = (k if g is None else g + z for g, k, z in zip(goal, kept, zero, strict=True))
        self._plant.goal = a, b

    def recover(self) -> None:
        """Do nothing: it never fails."""

    def torque(self, on: bool) -> None:
        """Hold the handles, also without torque."""
        self._plant.goal = self._plant.handles

    def zero(self, position: tuple[float, ...]) -> None:
        """Make this position [rad] the zero of both axes."""
        a, b = self.quantise((self._zero[0] + position[0], self._zero[1] + position[1]))
        self._zero = a, b
        self._limit()

    def close(self) -> None:
        """Hold the handles."""
        self.torque(False)

    def _limit(self) -> None:
        reach, speed = self._instrument.handle_range_rad, self._instrument.handle_speed_rad_s
        self.limits = Limits(
            position_rad=tuple((-reach - z, reach - z) for z in self._zero),
            velocity_rad_s=(speed,) * len(self.axes),
        )


def _check(scenario: Scenario) -> None:
    for what in ("shaft", "push", "tracker"):
        if getattr(scenario, what):
            raise ConfigError(
                f"scenario {scenario.name} has [{what}], which rigs without physics do not model",
                "use --rig twin",
            )
