"""What `endolock doctor` reads from one motor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from endolock.hw.dynamixel import models
from endolock.hw.dynamixel.models import Model


@dataclass(frozen=True, kw_only=True)
class FoundMotor:
    """Registers read from one motor."""

    id: int
    model: int
    firmware: int
    baud: int
    hardware_error: int = 0
    watchdog: int = 0
    torque: int = 0
    settings: Mapping[str, int] = field(default_factory=dict)
    """Value of each of `settings.SETTINGS` by name; empty where the model is unknown, or the motor
    answers to pings only."""

    @property
    def known(self) -> Model | None:
        """Its model, if it can drive a handle."""
        return models.MODELS.get(self.model)

    @property
    def name(self) -> str:
        """Name of its model."""
        return models.described(self.model).partition(":")[0]

    @property
    def mute(self) -> bool:
        """Whether it answers to pings only."""
        return self.known is not None and not self.settings
