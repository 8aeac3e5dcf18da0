"""What a guard drives: something that takes goals and returns measurements, and no more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from endolock.hw.api import Clock, Limits


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What a drive measured in one transfer."""

    t: float
    t_err: float
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    current: tuple[float, ...]
    fresh: bool
    """False where no answer came; the measurements are then the last ones."""
    device_tick: int
    goal: tuple[float, ...] | None = None
    """Goals that the motors report [rad]; None where they do not."""
    silent: tuple[str, ...] = ()
    """Axes that did not answer, where that is known."""

    def heard(self, axis: str) -> bool:
        """Return whether an axis answered."""
        return self.fresh or (bool(self.silent) and axis not in self.silent)


class Drive(Protocol):
    """The motors behind a guard. It may raise `DeviceFault`; the guard detects all other faults.

    It makes no goal and no zero out of what it measures: that is the guard's decision.
    """

    @property
    def axes(self) -> tuple[str, ...]:
        """Axis names, in the order of every tuple here."""

    @property
    def step_rad(self) -> tuple[float, ...]:
        """Handle angle of one step of the encoder of each axis [rad]."""

    @property
    def limits(self) -> Limits:
        """Limits of position and speed, counted from the present zero."""

    @property
    def clock(self) -> Clock:
        """The clock that stamps its readings."""

    def open(self) -> None:
        """Open the device, torque off."""

    def transfer(self, goal: tuple[float, ...] | None) -> Reading:
        """Send a goal [rad], or none, and measure."""

    def quantise(self, goal: tuple[float, ...]) -> tuple[float, ...]:
        """Return the nearest goal that the device can represent [rad]."""

    def measure(self) -> Reading:
        """Measure, whatever state the motors are in; raises none of their faults."""

    def hold(self, goal: tuple[float | None, ...]) -> None:
        """Send a goal [rad] to every motor that still responds; with None it keeps its goal."""

    def torque(self, on: bool) -> None:
        """Switch torque on or off."""

    def zero(self, position: tuple[float, ...]) -> None:
        """Make this position [rad] the zero of every axis."""

    def recover(self) -> None:
        """Reopen the device after a fault, torque off.

        Raises:
            HardwareError: it is not available yet.
        """

    def close(self) -> None:
        """Switch torque off and release the device."""
