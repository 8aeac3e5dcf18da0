"""How a servo drives a handle wheel: its id, zero, direction, gear ratio and limits."""

from __future__ import annotations

from pydantic import Field, field_validator

from endolock.hw.dynamixel.registers import LARGEST_GOAL
from endolock.hw.errors import ConfigError
from endolock.hw.files import Section


class Handle(Section):
    """One handle and its motor."""

    id: int = Field(ge=0, le=252)
    """Id of the motor on the bus."""
    direction: int = 1
    """1 if the handle angle increases with the motor's position, else -1."""
    zero_counts: int | None = Field(default=None, ge=-LARGEST_GOAL // 2, le=LARGEST_GOAL // 2)
    """Motor position at handle angle zero [counts]; None: its position when the rig connects."""
    ratio: float = Field(default=1.0, gt=0, le=100)
    """Turns of the motor per turn of the handle [1]."""
    range_rad: tuple[float, float] = (-3.0, 3.0)
    """Lowest and highest handle angle [rad]. Assumed: somewhat less than half a turn."""
    speed_rad_s: float = Field(default=3.49, gt=0)
    """Maximum speed of the goal [rad/s]. Assumed: 33 rpm, a small servo under load."""
    current_limit_a: float | None = Field(default=None, ge=0.02, le=3.2)
    """Largest motor current [A]; None: as set in the motor. X series registers end at 3.2 A."""

    @field_validator("direction")
    @classmethod
    def _sign(cls, value: int) -> int:
        if value not in (1, -1):
            raise ConfigError(f"direction is {value}", "use 1 or -1")
        return value

    @field_validator("range_rad")
    @classmethod
    def _ordered(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not value[0] < value[1]:
            raise ConfigError(f"range_rad is {list(value)}", "give the lower end first")
        return value

    def unit_rad(self, position_rad: float) -> float:
        """Return the handle angle of one count, signed [rad].

        Args:
            position_rad: motor angle of one count [rad].
        """
        return position_rad * self.direction / self.ratio
