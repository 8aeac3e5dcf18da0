"""Feed-forward compensation of hysteresis: a law's handle angles, and half a loop width on top.

Where a play of full width w lies between handle and tip, the tip follows v if the handle is at
v + (w/2) s, with s = +-1 the direction in which v moves. The thesis' width is 0.2 (eq. 4.5, unit
not stated; taken as a share of 180 deg), and its form is not in the excerpt. Forms of s here:

    sign    of the speed of v; 0 from where that is slower than `switch_off_rad_s` until it is
            twice as fast, so that noise does not switch it to and fro
    play    (v - z)/r, with z the play of half-width r = `reversal_rad` behind v
    ramp    as sign, but it takes `ramp_s` from one side to the other, and stays where v rests
    smooth  tanh(speed of v / `smooth_rad_s`)

The thesis switches compensation off at rest, once too early (fig. 6.8). Without that a compensation
wider than the loop rings on an axis whose target rests, as soon as noise has set it off.

Reference:
    G. Tao and P. V. Kokotovic, Adaptive Control of Systems with Actuator and Sensor
    Nonlinearities, 1996 (backlash inverse).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import copysign, isfinite, pi, tanh
from typing import Literal

from endolock.control.laws.pi import PI, PIMemory, PISettings
from endolock.control.laws.pi_simc import SimcMemory, SimcPI, SimcSettings
from endolock.control.transmission.kinematics import Pair
from endolock.control.transmission.plays import play_step
from endolock.hw.api import AXES, Calibration, Command, ConfigError, State
from endolock.vision.observation import Observation

ON_OVER_OFF = 2.0
"""Speed at which v counts as moving again, over the speed below which it rests [1]. Assumed."""
SPEED_S = 0.08
"""Time constant of the speed of v [s]: two frames; without it each frame is a step. Assumed."""


@dataclass(frozen=True, kw_only=True)
class CompensationSettings:
    """How hysteresis is compensated."""

    form: Literal["sign", "play", "ramp", "smooth"] = "sign"
    """See above. Assumed."""
    width: float = 0.2
    """Full loop width w at the handle, as a share of 180 deg [1], >= 0. Source: 0.2, thesis
    ch. 6; unit assumed."""
    switch_off_rad_s: float = 0.01
    """sign, ramp: a slower v rests [rad/s], >= 0. That there is a switch-off: thesis, fig. 6.8.
    Its size: of 0.005, 0.01, 0.02 and 0.05 the smallest with which an axis whose target rests does
    not ring at 1 px of noise, ten times that of markers
    (scripts/studies/controller_calibration.py)."""
    reversal_rad: float = 0.01
    """play: half-width of the play that finds the direction [rad], > 0. Assumed."""
    ramp_s: float = 0.4
    """ramp: from one side to the other [s], > 0. Assumed."""
    smooth_rad_s: float = 0.1
    """smooth: speed at which three quarters of the compensation are there [rad/s], > 0. Assumed."""

    def __post_init__(self) -> None:
        least = min(self.reversal_rad, self.ramp_s, self.smooth_rad_s)
        numbers = (self.width, self.switch_off_rad_s, least)
        good = least > 0 and min(self.width, self.switch_off_rad_s) >= 0
        if not (good and all(isfinite(n) for n in numbers)):
            raise ConfigError(
                f"compensation: width {self.width:g}, switch_off_rad_s {self.switch_off_rad_s:g}, "
                f"smallest other number {least:g}",
                "use 0 or more, and more than 0",
            )


@dataclass
class Direction:
    """What one axis remembers of the way its law goes."""

    speed: float = 0.0
    """Of v, low-passed [rad/s]."""
    behind: float = 0.0
    """z of the play form [rad]."""
    side: float = 0.0
    """s [1]."""
    moving: bool = False
    """Whether v does not rest."""


def follow(
    settings: CompensationSettings, direction: Direction, before: float, now: float, dt: float
) -> float:
    """Take in one step of v; return the compensation [rad].

    Args:
        settings: form and width.
        direction: of the axis; is renewed.
        before: v at the last tick [rad].
        now: v at this tick [rad].
        dt: time between [s]; 0 in the first tick.
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
        PISettings.__post_init__(self)
        CompensationSettings.__post_init__(self)


@dataclass(frozen=True, kw_only=True)
class SimcHCSettings(CompensationSettings, SimcSettings):
    """Tuning and compensation."""

    form: Literal["sign", "play", "ramp", "smooth"] = "smooth"
    """Assumed: with these gains hard switching chatters."""

    def __post_init__(self) -> None:
        SimcSettings.__post_init__(self)
        CompensationSettings.__post_init__(self)


@dataclass
class CompensatedMemory:
    """What the law remembers."""

    law: SimcMemory | PIMemory
    """Of the law that is compensated."""
    wanted: Pair | None = None
    """What that law wanted last, v [rad]."""
    t: float = 0.0
    """When [s]."""
    directions: tuple[Direction, Direction] = field(
        default_factory=lambda: (Direction(), Direction())
    )


class Compensated:
    """A PI law with compensation.

    Args:
        law: the law.
        settings: of the compensation.
    """

    def __init__(self, law: PI, settings: CompensationSettings) -> None:
        self._law, self._settings = law, settings
        self._memory = CompensatedMemory(law.memory)

    @property
    def gains(self) -> Pair:
        """Kp [rad/rad] and ki [1/s] in force."""
        return self._law.gains

    @property
    def memory(self) -> CompensatedMemory:
        """What the law remembers."""
        self._memory.law = self._law.memory
        return self._memory

    @memory.setter
    def memory(self, memory: CompensatedMemory) -> None:
        self._memory = memory
        self._law.memory = memory.law

    @property
    def signals(self) -> dict[str, float]:
        """Compensation of both axes [rad]."""
        half = self._settings.width * pi / 2
        named = zip(AXES, self._memory.directions, strict=True)
        return {f"compensation_{axis}_rad": half * one.side for axis, one in named}

    def reset(self, state: State) -> None:
        """Start from where the handles are, uncompensated: nothing is known of the direction."""
        self._law.reset(state)
        self._memory = CompensatedMemory(self._law.memory)

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Ask the law, and compensate; see `Controller.update`."""
        up_down, left_right = self._law.update(t, state, observation).position
        wanted, memory = (up_down, left_right), self._memory
        if memory.wanted is None:
            for direction, v in zip(memory.directions, wanted, strict=True):
                direction.behind = v
        dt = 0.0 if memory.wanted is None else t - memory.t
        before = memory.wanted or wanted
        one, other = (
            v + follow(self._settings, direction, v_before, v, dt)
            for direction, v_before, v in zip(memory.directions, before, wanted, strict=True)
        )
        memory.wanted, memory.t = wanted, t
        return Command(position=(one, other))


def pi_hc(calibration: Calibration, settings: PIHCSettings) -> Compensated:
    """Make the thesis-like PI law with compensation."""
    return Compensated(PI(calibration, settings), settings)


def pi_simc_hc(calibration: Calibration, settings: SimcHCSettings) -> Compensated:
    """Make the re-tuned PI law with compensation."""
    return Compensated(SimcPI(calibration, settings), settings)
