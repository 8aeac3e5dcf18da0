"""Feed-forward compensation of hysteresis: adds half a loop width to a controller's goals.

With a play of full width w between handle and tip, the tip follows v if the handle is at
v + (w/2) s, with s = +-1 the direction in which v moves. The thesis' width is 0.2 (eq. 4.5, unit
not stated; taken as a fraction of 180 deg), and its form is not in the excerpt. Forms of s here:

    sign    sign of the speed of v; 0 once it is below `switch_off_rad_s` and until it exceeds
            twice that, so that noise does not toggle it
    play    (v - z)/r, with z the play of half-width r = `reversal_rad` of v
    ramp    like sign, but changes sides in `ramp_s`, and stays constant while v is at rest
    smooth  tanh(speed of v / `smooth_rad_s`)

The thesis switches compensation off at rest, once too early (fig. 6.8). Without the switch-off, a
compensation wider than the loop oscillates on an axis whose target is at rest, started by noise.

Reference:
    G. Tao and P. V. Kokotovic, Adaptive Control of Systems with Actuator and Sensor
    Nonlinearities, 1996 (backlash inverse).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import copysign, pi, tanh
from typing import Annotated, Literal

from endolock.control.laws.pi import PI, PIMemory, PISettings
from endolock.control.laws.pi_simc import SimcMemory, SimcPI, SimcSettings
from endolock.control.transmission.kinematics import Pair
from endolock.control.transmission.plays import play_step
from endolock.hw.api import AXES, Calibration, Command, State
from endolock.hw.strict import bounded
from endolock.hw.strict_fields import settle
from endolock.vision.observation import Observation

ON_OVER_OFF = 2.0
"""Ratio of the speed above which v counts as moving to that below which it is at rest [1].
Assumed."""
SPEED_S = 0.08
"""Time constant of the low-pass on the speed of v [s]: two frames, because v moves in steps at
each frame. Assumed."""


@dataclass(frozen=True, kw_only=True)
class CompensationSettings:
    """Form and width of the compensation."""

    form: Literal["sign", "play", "ramp", "smooth"] = "sign"
    """Form of s, see the module's description. Assumed."""
    width: Annotated[float, bounded(0, 4)] = 0.2
    """Full loop width w at the handle, as a fraction of 180 deg [1], 0 to 4. Source: 0.2, thesis
    ch. 6; unit assumed."""
    switch_off_rad_s: Annotated[float, bounded(0, 100, "rad/s")] = 0.01
    """sign, ramp: speed below which v is at rest [rad/s], 0 to 100. Source of the switch-off:
    thesis, fig. 6.8. Its value: of 0.005, 0.01, 0.02 and 0.05 the smallest at which an axis with a
    target at rest does not oscillate at 1 px of noise, ten times that of markers
    (scripts/studies/controller_calibration.py)."""
    reversal_rad: Annotated[float, bounded(1e-6, 10, "rad")] = 0.01
    """play: half-width of the play that determines the direction [rad], 1e-6 to 10. Assumed."""
    ramp_s: Annotated[float, bounded(0.001, 1000, "s")] = 0.4
    """ramp: time to change sides [s], 0.001 to 1000. Assumed."""
    smooth_rad_s: Annotated[float, bounded(1e-6, 1000, "rad/s")] = 0.1
    """smooth: speed at which three quarters of the compensation are reached [rad/s], 1e-6 to 1000.
    Assumed."""

    def __post_init__(self) -> None:
        settle(self, "compensation")


@dataclass
class Direction:
    """Direction of motion of one axis."""

    speed: float = 0.0
    """Speed of v, low-passed [rad/s]."""
    behind: float = 0.0
    """Output z of the play [rad]."""
    side: float = 0.0
    """s [1]."""
    moving: bool = False
    """Whether v is moving."""


def follow(
    settings: CompensationSettings, direction: Direction, before: float, now: float, dt: float
) -> float:
    """Update the direction with one step of v; return the compensation [rad].

    Args:
        settings: form and width.
        direction: of the axis; is updated.
        before: v at the previous tick [rad].
        now: v at this tick [rad].
        dt: time between the ticks [s]; 0 at the first one.
    """
    if dt > 0:
        share = dt / (SPEED_S + dt)
        direction.speed += share * ((now - before) / dt - direction.speed)
    speed, reach = direction.speed, settings.reversal_rad
    rest = settings.switch_off_rad_s * (1.0 if direction.moving else ON_OVER_OFF)
    direction.moving = abs(speed) > rest
    sign = copysign(direction.moving, speed)
    direction.behind = play_step(direction.behind, now, reach)
    match settings.form:
        case "sign":
            direction.side = sign
        case "play":
            direction.side = (now - direction.behind) / reach
        case "ramp":
            step = 2 * dt / settings.ramp_s
            direction.side = min(max(direction.side + sign * step, -1.0), 1.0)
        case "smooth":
            direction.side = tanh(speed / settings.smooth_rad_s)
    return settings.width * pi / 2 * direction.side


@dataclass(frozen=True, kw_only=True)
class PIHCSettings(CompensationSettings, PISettings):
    """Gains and compensation."""

    def __post_init__(self) -> None:
        settle(self, "pi_hc")


@dataclass(frozen=True, kw_only=True)
class SimcHCSettings(CompensationSettings, SimcSettings):
    """Tuning and compensation."""

    form: Literal["sign", "play", "ramp", "smooth"] = "smooth"
    """Form of s, see the module's description. Assumed: with these gains a sign chatters."""

    def __post_init__(self) -> None:
        settle(self, "pi_simc_hc")


@dataclass
class CompensatedMemory:
    """State of the controller."""

    controller: SimcMemory | PIMemory
    """State of the compensated controller."""
    goals: Pair | None = None
    """Last goals of that controller, v [rad]."""
    t: float = 0.0
    """Time of these goals [s]."""
    directions: tuple[Direction, Direction] = field(
        default_factory=lambda: (Direction(), Direction())
    )
    """Directions of up_down and left_right."""


class Compensated:
    """PI controller with compensation.

    Args:
        controller: the PI controller.
        settings: settings of the compensation.
    """

    def __init__(self, controller: PI, settings: CompensationSettings) -> None:
        self._controller, self._settings = controller, settings
        self._memory = CompensatedMemory(controller.memory)

    @property
    def gains(self) -> Pair:
        """Kp [rad/rad] and ki [1/s] in use."""
        return self._controller.gains

    @property
    def memory(self) -> CompensatedMemory:
        """State of the controller."""
        self._memory.controller = self._controller.memory
        return self._memory

    @memory.setter
    def memory(self, memory: CompensatedMemory) -> None:
        self._memory = memory
        self._controller.memory = memory.controller

    @property
    def signals(self) -> dict[str, float]:
        """Compensation of both axes [rad]."""
        half = self._settings.width * pi / 2
        named = zip(AXES, self._memory.directions, strict=True)
        return {f"compensation_{axis}_rad": half * direction.side for axis, direction in named}

    def reset(self, state: State) -> None:
        """Start from the present handle angles, without compensation: the direction is unknown."""
        self._controller.reset(state)
        self._memory = CompensatedMemory(self._controller.memory)

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Compensate the goals of the PI controller; see `Controller.update`."""
        memory = self._memory
        v_up_down, v_left_right = self._controller.update(t, state, observation).position
        goals = v_up_down, v_left_right
        if memory.goals is None:
            for direction, v in zip(memory.directions, goals, strict=True):
                direction.behind = v
        dt = 0.0 if memory.goals is None else t - memory.t
        before = memory.goals or goals
        up_down, left_right = (
            v + follow(self._settings, direction, v_before, v, dt)
            for direction, v_before, v in zip(memory.directions, before, goals, strict=True)
        )
        memory.goals, memory.t = goals, t
        return Command(position=(up_down, left_right))


def pi_hc(calibration: Calibration, settings: PIHCSettings) -> Compensated:
    """Make the thesis-like PI controller with compensation."""
    return Compensated(PI(calibration, settings), settings)


def pi_simc_hc(calibration: Calibration, settings: SimcHCSettings) -> Compensated:
    """Make the re-tuned PI controller with compensation."""
    return Compensated(SimcPI(calibration, settings), settings)
