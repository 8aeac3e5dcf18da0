"""Kinds of motion of the board within its plane; a scenario adds them up."""

from __future__ import annotations

from array import array
from math import cos, exp, pi, radians, sin, sqrt
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from endolock.hw.api import ConfigError
from endolock.hw.strict import Strict, bounded

Offset = tuple[float, float]
"""Displacement of the board (right, down) [m]."""

Angle = Annotated[float, bounded(-360, 360, "deg")]
_Travel = Annotated[float, bounded(0, 2, "m", hint="give metres")]
_Period = Annotated[float, bounded(0.02, 1e9, "s", hint="give seconds")]
_Time = Annotated[float, bounded(0, 86400, "s", hint="give seconds, up to a day")]
_Span = Annotated[float, bounded(0.001, 86400, "s", hint="give seconds, up to a day")]
FARTHEST_RMS_M = 1.0
"""Largest rms displacement of a random motion [m]. Assumed: as far as boards are away."""


def along(length: float, direction_deg: float) -> Offset:
    """Return (right, down) of a length in a direction in the picture: 0 right, 90 up [deg]."""
    angle = radians(direction_deg)
    return length * cos(angle), -length * sin(angle)


class Event(Strict):
    """A change that happens once, at a constant rate."""

    start_s: _Time
    """Start [s]."""
    over_s: _Span
    """Duration [s]."""

    def done(self, t: float) -> float:
        """Return the completed fraction at time `t` [s]: 0 before, 1 after."""
        return min(max((t - self.start_s) / self.over_s, 0.0), 1.0)


class Strokes(Strict):
    """One-sided strokes along a line, s = travel/2 (1 - cos(2 pi t / period))."""

    kind: Literal["strokes"]
    direction_deg: Angle = 0.0
    """In the picture: 0 right, 90 up [deg]."""
    travel_m: _Travel
    """Longest distance from the start [m]."""
    period_s: _Period
    """Time of one stroke out and back [s]."""

    def offset(self, t: float) -> Offset:
        """Displacement (right, down) at time `t` [m]."""
        s = self.travel_m / 2 * (1 - cos(2 * pi * t / self.period_s))
        return along(s, self.direction_deg)


class Triangle(Strict):
    """One-sided strokes along a line at constant speed 2 travel / (period - turn).

    Each reversal takes `turn_s`, at constant acceleration; the motion starts at rest, halfway
    through a reversal.
    """

    kind: Literal["triangle"]
    direction_deg: Angle = 0.0
    """In the picture: 0 right, 90 up [deg]."""
    travel_m: _Travel
    """Longest distance from the start [m]."""
    period_s: _Period
    """Time of one stroke out and back [s]."""
    turn_s: _Span = 0.3
    """Duration of a reversal from full speed to full speed [s], at most half a period. Assumed."""

    @model_validator(mode="after")
    def _turns_fit(self) -> Self:
        if self.turn_s > self.period_s / 2:
            raise ConfigError(
                f"turn_s {self.turn_s:g} is more than half of period_s {self.period_s:g}",
                "use less",
            )
        return self

    def offset(self, t: float) -> Offset:
        """Displacement (right, down) at time `t` [m]."""
        speed = 2 * self.travel_m / (self.period_s - self.turn_s)
        since = t % self.period_s
        since = min(since, self.period_s - since)  # the return mirrors the way out
        rest = min(since, self.period_s / 2 - since)  # and its second half the first
        half_turn = self.turn_s / 2
        s = speed * (rest - half_turn / 2 if rest > half_turn else rest**2 / self.turn_s)
        return along(s if rest == since else self.travel_m - s, self.direction_deg)


class Circle(Strict):
    """A circle around the optical axis at rest, clockwise in the picture, starting on the right."""

    kind: Literal["circle"]
    radius_m: _Travel
    """Radius [m]."""
    period_s: _Period
    """Time of one revolution [s]."""

    def offset(self, t: float) -> Offset:
        """Displacement (right, down) at time `t` [m]."""
        phase = 2 * pi * t / self.period_s
        return self.radius_m * cos(phase), self.radius_m * sin(phase)


class Sine(Strict):
    """Two-sided motion along a line, s = travel/2 sin(phase).

    The frequency, f = phase'/(2 pi), may drift to and fro around its mean:

        f(t) = frequency (1 + drift_share sin(2 pi t / drift_period))
    """

    kind: Literal["sine"]
    direction_deg: Angle = 0.0
    """In the picture: 0 right, 90 up [deg]."""
    travel_m: _Travel
    """Travel from peak to peak [m]."""
    frequency_hz: Annotated[float, bounded(0, 50, "Hz")]
    """Mean frequency [Hz]."""
    drift_share: Annotated[float, bounded(0, 0.9)] = 0.0
    """Largest change of the frequency over its mean [1]."""
    drift_period_s: _Period = 60.0
    """Time in which the frequency goes up, down and back [s]. Assumed."""

    def offset(self, t: float) -> Offset:
        """Displacement (right, down) at time `t` [m]."""
        phase = 2 * pi * self.frequency_hz * (t + self._ahead_s(t))
        return along(self.travel_m / 2 * sin(phase), self.direction_deg)

    def _ahead_s(self, t: float) -> float:
        """Time by which the drift of the frequency has moved the motion ahead [s]."""
        drift = 2 * pi / self.drift_period_s
        return self.drift_share * (1 - cos(drift * t)) / drift if self.drift_share else 0.0


class Jump(Event):
    """A move to another position at constant speed; the board stays there."""

    kind: Literal["jump"]
    direction_deg: Angle = 0.0
    """In the picture: 0 right, 90 up [deg]."""
    travel_m: _Travel
    """Distance [m]."""

    def offset(self, t: float) -> Offset:
        """Displacement (right, down) at time `t` [m]."""
        return along(self.travel_m * self.done(t), self.direction_deg)


class Random(Strict):
    """White noise through a second-order low-pass, x'' + 2 zeta w x' + w^2 x = noise, per axis.

    With zeta = 1/sqrt(2) the spectrum of the position is flat up to the cutoff w = 2 pi f and falls
    as 1/(1 + (f/cutoff)^4); rms position = rms speed / w. The motion is stationary from the start.
    """

    kind: Literal["random"]
    speed_rms_m_s: Annotated[float, bounded(0, 2, "m/s", hint="give metres per second")] = 0.03
    """Root mean square of the speed along each axis [m/s]. Assumed."""
    cutoff_hz: Annotated[float, bounded(0.001, 20, "Hz")] = 0.3
    """Corner frequency of the low-pass [Hz]. Assumed; so is its damping of 1/sqrt(2)."""

    @property
    def rms_position_m(self) -> float:
        """Root mean square of the displacement along each axis [m]."""
        return self.speed_rms_m_s / (2 * pi * self.cutoff_hz)

    @model_validator(mode="after")
    def _stays_near(self) -> Self:
        if self.rms_position_m > FARTHEST_RMS_M:
            raise ConfigError(
                f"speed_rms_m_s {self.speed_rms_m_s:g} and cutoff_hz {self.cutoff_hz:g} move the "
                f"board by {self.rms_position_m:g} m rms, wanted 0 to {FARTHEST_RMS_M:g} m",
                "use a lower speed or a higher cutoff",
            )
        return self

    def path(self, generator: np.random.Generator) -> RandomPath:
        """Draw one realisation of the motion."""
        return RandomPath(self, generator)


class RandomPath:
    """One realisation of a random motion: samples on a grid, drawn in order when first needed.

    The samples are exact for any grid: s[n+1] = Phi s[n] + L z with Phi = exp(A h) and
    L L' = P - Phi P Phi', P the stationary covariance. Between samples, a cubic matches position
    and speed of both neighbours. The result is bit-identical in whatever order times are queried.

    Args:
        random: parameters of the motion.
        generator: random numbers for this path alone; it draws from them as long as it is used.
    """

    STEPS_PER_PERIOD = 300
    """Samples per period of the cutoff frequency: one per 11 ms at 0.3 Hz. Between samples the
    cubic differs from an exact path by less than 0.1 % of the rms position."""
    _CHUNK = 256

    def __init__(self, random: Random, generator: np.random.Generator) -> None:
        self._generator = generator
        self._step_s = 1 / (random.cutoff_hz * self.STEPS_PER_PERIOD)
        # In units of rms position and rms speed P is the identity, and Phi depends on w h alone.
        phase = 2 * pi / self.STEPS_PER_PERIOD
        a, decay = phase / sqrt(2), exp(-phase / sqrt(2))
        self._phi = decay * np.array(
            [[cos(a) + sin(a), sqrt(2) * sin(a)], [-sqrt(2) * sin(a), cos(a) - sin(a)]]
        )
        self._noise = np.linalg.cholesky(np.eye(2) - self._phi @ self._phi.T)
        rms_position = random.rms_position_m
        self._scale = np.array([rms_position, rms_position * phase])
        self._state = generator.standard_normal((2, 2))  # axis; position, speed
        self._samples = array("d")  # right, speed, down, speed; speeds in metres per step
        self._keep(self._state[None])

    def offset(self, t: float) -> Offset:
        """Displacement (right, down) at time `t` >= 0 [m]."""
        steps = t / self._step_s
        n = int(steps)
        first = 4 * n
        while len(self._samples) < first + 8:
            self._draw()
        x0, vx0, y0, vy0, x1, vx1, y1, vy1 = self._samples[first : first + 8]
        b = steps - n
        a = 1 - b
        end, begin = b * b * (3 - 2 * b), a * a * (3 - 2 * a)
        leave, arrive = a * a * b, -a * b * b
        return (
            begin * x0 + end * x1 + leave * vx0 + arrive * vx1,
            begin * y0 + end * y1 + leave * vy0 + arrive * vy1,
        )

    def _draw(self) -> None:
        shocks = self._generator.standard_normal((self._CHUNK, 2, 2)) @ self._noise.T
        rows = np.empty_like(shocks)
        for n, shock in enumerate(shocks):
            self._state = rows[n] = self._state @ self._phi.T + shock
        self._keep(rows)

    def _keep(self, rows: np.ndarray) -> None:
        self._samples.frombytes(np.ascontiguousarray(rows * self._scale).tobytes())


BoardMotion = Annotated[
    Strokes | Triangle | Circle | Sine | Jump | Random, Field(discriminator="kind")
]
"""Any kind of motion, distinguished by `kind`."""
KINDS: dict[str, type[Strict]] = {
    "strokes": Strokes,
    "triangle": Triangle,
    "circle": Circle,
    "sine": Sine,
    "jump": Jump,
    "random": Random,
}
