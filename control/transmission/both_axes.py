"""Both axes of a section behind their wires, coupled by each other's bend."""

from __future__ import annotations

from dataclasses import dataclass

from endolock.control.transmission.kinematics import Pair
from endolock.control.transmission.quasi_static import Axis, Cable, Geometry


class BothAxes:
    """Both axes of a section; the bend of each adds friction to the other's wires and supports it.

    Args:
        up_down: first axis.
        left_right: second axis.
    """

    def __init__(self, up_down: Axis, left_right: Axis) -> None:
        self._axes = up_down, left_right

    def follow(self, handles: Pair) -> Pair:
        """Move the handles to angles [rad]; return the bends [rad]."""
        up_down, left_right = self._axes
        bend = up_down.follow(handles[0], handles[1], left_right.bend_rad)
        return bend, left_right.follow(handles[1], handles[0], bend)

    def rub(self, times: float) -> None:
        """Set the friction of all wires to a multiple of that at rest [1]."""
        for axis in self._axes:
            axis.rub(times)


@dataclass(frozen=True, kw_only=True)
class CableTransmission:
    """Transmission from both handles to the section, the same on both axes."""

    cable: Cable
    """Wires and conduits."""
    geometry: Geometry
    """The section and its pulleys."""

    def at_rest(self) -> BothAxes:
        """Return both axes at rest, with the handles at zero."""
        up_down, left_right = (Axis(self.cable, self.geometry) for _ in range(2))
        return BothAxes(up_down, left_right)
