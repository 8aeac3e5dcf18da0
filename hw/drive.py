"""What a guard stands in front of: something that takes goals and gives measurements, no more."""

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
    """False where no answer came; the measurements then are the last ones."""
    device_tick: int
    goal: tuple[float, ...] | None = None
    """Goals that the motors have [rad], where they tell them."""
    silent: tuple[str, ...] = ()
    """Axes that did not answer, where single ones can be told."""


class Drive(Protocol):
    """The motors behind a guard. It may raise `DeviceFault`; everything else is the guard's."""

    @property
    def axes(self) -> tuple[str, ...]:
        """Axis names, in the order of every tuple here."""

    @property
    def limits(self) -> Limits:
        """What may be asked for, counted from the present zero."""

    @property
    def clock(self) -> Clock:
        """The clock that stamps its readings."""

    def open(self) -> None:
        """Get hold of the device, torque off."""

    def transfer(self, goal: tuple[float, ...] | None) -> Reading:
        """Send a goal [rad], or none, and measure."""

    def quantise(self, goal: tuple[float, ...]) -> tuple[float, ...]:
        """Return the nearest goal that the device can hold [rad]."""

    def hold(self) -> tuple[float, ...] | None:
        """Stop every motor that listens where it is; return where [rad], None if nobody answers."""

    def torque(self, on: bool) -> None:
        """Switch torque on or off."""

    def zero(self) -> None:
        """Make the present position the zero of every axis."""

    def recover(self) -> None:
        """Get the device ready again after a fault, torque off.

        Raises:
            HardwareError: it is not to be had yet.
        """

    def close(self) -> None:
        """Torque off, let go of the device."""
