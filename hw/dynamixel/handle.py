"""How a servo drives a handle wheel: its id, zero, direction, gear ratio and limits."""

from __future__ import annotations

from math import pi
from typing import Annotated

from pydantic import field_validator

from endolock.hw.errors import ConfigError
from endolock.hw.strict import Strict, bounded

_TURNS = 10 * 4096
"""Largest distance of a zero from 0 [counts]: motors start within their first turn. Assumed."""
LEAST_RANGE_RAD = 0.01
"""Least range of a handle [rad]: seven counts of a motor. Assumed."""
_Angle = Annotated[float, bounded(-2 * pi, 2 * pi, "rad", hint="give radians, not degrees")]


class Handle(Strict):
    """One handle and its motor."""

    id: Annotated[int, bounded(0, 252)]
    """Id of the motor on the bus."""
    direction: int = 1
    """1 if the handle angle increases with the motor's position, else -1."""
    zero_counts: (
        Annotated[
            int,
            bounded(
                -_TURNS, _TURNS, "counts", hint="let endolock doctor --port PORT --set-up find it"
            ),
        ]
        | None
    ) = None
    """Motor position at handle angle zero [counts]; None: its position when the rig connects."""
    ratio: Annotated[float, bounded(0.01, 100)] = 1.0
    """Turns of the motor per turn of the handle [1]."""
    range_rad: tuple[_Angle, _Angle] = (-3.0, 3.0)
    """Lowest and highest handle angle [rad], with 0 between them. Assumed: somewhat less than half
    a turn."""
    speed_rad_s: Annotated[float, bounded(0.01, 20, "rad/s", hint="give radians, not degrees")] = (
        3.49
    )
    """Maximum speed of the goal [rad/s]. Assumed: 33 rpm, a small servo under load; the fastest
    motors of the series turn at 11 rad/s."""
    current_limit_a: (
        Annotated[float, bounded(0.02, 5.5, "A", hint="give amperes, not milliamperes")] | None
    ) = None
    """Largest motor current [A], not more than the motor's own current limit; None: no limit but
    that of its PWM. Largest value: that of an XM540-W270."""

    @field_validator("direction")
    @classmethod
    def _sign(cls, value: int) -> int:
        if value not in (1, -1):
            raise ConfigError(f"direction is {value}", "use 1 or -1")
        return value

    @field_validator("range_rad")
    @classmethod
    def _around_zero(cls, value: tuple[float, float]) -> tuple[float, float]:
        low, high = value
        said = f"range_rad is [{low:g}, {high:g}]"
        if not low < high:
            raise ConfigError(said, "give the lower end first")
        if not low <= 0 <= high:
            raise ConfigError(
                f"{said} without 0, at which zero_counts are taken", "give a range around 0"
            )
        if high - low < LEAST_RANGE_RAD:
            raise ConfigError(f"{said}, less than {LEAST_RANGE_RAD:g} rad", "give a wider one")
        return value

    def unit_rad(self, position_rad: float) -> float:
        """Return the handle angle of one count, signed [rad].

        Args:
            position_rad: motor angle of one count [rad].
        """
        return position_rad * self.direction / self.ratio
