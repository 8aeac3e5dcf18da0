"""Plays of one axis in the internal model: fixed half-widths, identified weights."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi

from endolock.control.transmission.linear_process import BEND_PER_HANDLE
from endolock.control.transmission.plays import Hysteresis, Plays

RADII = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7)
"""Half-widths of the plays [rad], for loops of up to 0.45 of 180 deg."""
PRIOR = (BEND_PER_HANDLE, *[0.0] * (len(RADII) - 1))
"""Initial weights: no hysteresis, because over-compensation loses targets."""


@dataclass
class AxisPlays:
    """Plays of one axis."""

    weights: list[float] = field(default_factory=lambda: list(PRIOR))
    """Bend per handle angle of each play [rad/rad]."""
    outputs: list[float] = field(default_factory=lambda: [0.0] * len(RADII))
    """Outputs of the plays [rad]."""
    width_std: float = pi
    """Standard deviation of the mean loop width [rad]."""

    @property
    def model(self) -> Hysteresis:
        """The model, which updates the outputs."""
        return Hysteresis(Plays(radii=RADII, weights=tuple(self.weights)), self.outputs)

    @property
    def width(self) -> float:
        """Mean full loop width [rad]."""
        wide = sum(w * r for w, r in zip(self.weights, RADII, strict=True))
        return 2 * wide / max(sum(self.weights), 1e-6)
