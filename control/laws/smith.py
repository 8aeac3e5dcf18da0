"""Smith predictor: controls the error that remains once all past commands have taken effect.

A frame of age L shows e(t - L). The handles have moved since; with the gain K of the process and a
target at rest, the present error is

    e_now = e(t - L) - K (h(t) - h(t - L)),        h' = e_now / (K tc),

an integrator whose loop has no dead time, if K and L are right. L is the age of the frame itself.

Reference:
    O. J. M. Smith, Chem. Eng. Progress 53(5), 1957.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from endolock.control.laws.pi import error
from endolock.control.transmission import linear_process
from endolock.control.transmission.kinematics import Pair, SectionGeometry
from endolock.hw.api import Calibration, Command, State
from endolock.hw.history import AngleHistory
from endolock.hw.strict import bounded
from endolock.hw.strict_fields import settle
from endolock.vision.observation import Observation, Status


@dataclass(frozen=True, kw_only=True)
class SmithSettings:
    """Internal model, and speed of the loop."""

    target_distance_m: linear_process.Depth = 0.12
    """Depth of the target [m], 0.001 to 10. Source: 12 cm, thesis ch. 6."""
    bend_per_handle: linear_process.Slope = linear_process.BEND_PER_HANDLE
    """Slope of the transmission [rad/rad], 0.001 to 100. Assumed."""
    closed_loop_s: Annotated[float, bounded(0.001, 1000, "s")] = 0.2
    """Time constant tc of the loop without dead time [s], 0.001 to 1000. Assumed: half the latency;
    with hysteresis the gain is not constant, and a faster loop oscillates."""

    def __post_init__(self) -> None:
        settle(self, "smith")


@dataclass
class SmithMemory:
    """State of the controller."""

    goals: Pair = (0.0, 0.0)
    """Goals of the handles [rad]."""
    error: Pair | None = None
    """Error in the newest frame [rad]; None if it did not show the target."""
    then: Pair = (0.0, 0.0)
    """Handle angles at its exposure [rad]."""
    t: float | None = None
    """Time of the last tick [s]."""
    history: AngleHistory = field(default_factory=AngleHistory)
    """Past handle angles."""


class Smith:
    """Integrator on the predicted error, on both axes.

    Args:
        calibration: turns pixels into angles.
        settings: model and speed; the defaults if None.
        geometry: lengths of the section; the defaults if None.
    """

    def __init__(
        self,
        calibration: Calibration,
        settings: SmithSettings | None = None,
        geometry: SectionGeometry | None = None,
    ) -> None:
        made = settings or SmithSettings()
        self._calibration = calibration
        self.gain = linear_process.image_gain(
            geometry or SectionGeometry(), made.target_distance_m, made.bend_per_handle
        )
        """K of the model [rad/rad]."""
        self.closed_loop_s = made.closed_loop_s
        """tc [s]."""
        self.memory = SmithMemory()

    def reset(self, state: State) -> None:
        """Hold the handles at their present goals."""
        self.memory = SmithMemory(goals=(state.goal[0], state.goal[1]))

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Integrate the predicted error; hold without a target.

        See `Controller.update`.
        """
        memory = self.memory
        memory.history.append(state)
        if observation is not None:
            memory.error = None
            if observation.status is Status.TRACKING:
                memory.error = error(self._calibration, observation)
                memory.then = memory.history.at(observation.t_capture)
        dt = 0.0 if memory.t is None else t - memory.t
        memory.t = t
        if memory.error is not None:
            up_down, left_right = (
                h if clipped * e > 0 else h + dt * e / (self.gain * self.closed_loop_s)
                for h, e, clipped in zip(
                    memory.goals, self._remaining(state, memory.error), state.clipped, strict=True
                )
            )
            memory.goals = up_down, left_right
        return Command(position=memory.goals)

    def _remaining(self, state: State, errors: Pair) -> Pair:
        """Error after the motion of the handles since the exposure [rad]."""
        up_down, left_right = (
            e - self.gain * (now - then)
            for e, now, then in zip(errors, state.position, self.memory.then, strict=True)
        )
        return up_down, left_right
