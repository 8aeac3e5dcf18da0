"""Smith predictor: control the error that is left once all commands under way have arrived.

A frame of age L tells e(t - L). The handles have moved since, and with the gain K of the process
the error without the target's own motion is

    e_now = e(t - L) - K (h(t) - h(t - L)),        h' = e_now / (K tc),

an integrator whose loop has no dead time, if K and L are right. L is the age of the frame itself.

Reference:
    O. J. M. Smith, Chem. Eng. Progress 53(5), 1957.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from endolock.control.laws.pi import error
from endolock.control.transmission import linear_process
from endolock.control.transmission.kinematics import Pair, SectionGeometry
from endolock.hw.api import Calibration, Command, ConfigError, State
from endolock.hw.history import AngleHistory
from endolock.vision.observation import Observation, Status


@dataclass(frozen=True, kw_only=True)
class SmithSettings:
    """The model inside, and how fast the loop shall be."""

    target_distance_m: float = 0.12
    """Depth of the target [m], > 0. Source: 12 cm, thesis ch. 6."""
    bend_per_handle: float = linear_process.BEND_PER_HANDLE
    """Slope of the transmission [rad/rad], > 0. Assumed."""
    closed_loop_s: float = 0.2
    """Time constant tc of the loop without dead time [s], > 0. Assumed: half the latency; with
    hysteresis the gain is far from constant, and a faster loop rings."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 < value < float("inf"):
                raise ConfigError(f"smith: {name} is {value:g}", "use a finite number above 0")


@dataclass
class SmithMemory:
    """What the law remembers."""

    handles: Pair = (0.0, 0.0)
    """Where it wants the handles now [rad]."""
    error: Pair | None = None
    """Of the newest frame that showed the target [rad]."""
    then: Pair = (0.0, 0.0)
    """Where the handles were at its exposure [rad]."""
    t: float | None = None
    """Of the last tick [s]."""
    past: AngleHistory = field(default_factory=AngleHistory)
    """Where the handles were."""


class Smith:
    """Integrator on the predicted error, on both axes.

    Args:
        calibration: turns pixels into angles.
        settings: the model; the defaults if None.
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
        """Stay where the handles are."""
        self.memory = SmithMemory(handles=(state.position[0], state.position[1]))

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Integrate what is left of the newest error; stop without a target.

        See `Controller.update`.
        """
        memory = self.memory
        memory.past.append(state)
        if observation is not None:
            memory.error = None
            if observation.status is Status.TRACKING:
                memory.error = error(self._calibration, observation)
                memory.then = memory.past.at(observation.t_capture)
        dt = 0.0 if memory.t is None else t - memory.t
        memory.t = t
        if memory.error is not None:
            up_down, left_right = (
                h if clipped * left > 0 else h + dt * left / (self.gain * self.closed_loop_s)
                for h, left, clipped in zip(
                    memory.handles, self._left(state, memory.error), state.clipped, strict=True
                )
            )
            memory.handles = up_down, left_right
        return Command(position=memory.handles)

    def _left(self, state: State, seen: Pair) -> Pair:
        """Error that the handles' motion since the exposure leaves [rad]."""
        up_down, left_right = (
            e - self.gain * (now - then)
            for e, now, then in zip(seen, state.position, self.memory.then, strict=True)
        )
        return up_down, left_right
