"""Slow following of the target while neither background nor model can be relied on.

Prediction without a model of hysteresis oscillates, and a wrong model loses the target. The place
to look at follows the target with a time constant of more than twice the latency, so that the loop
is stable without a model. Far from the axis it follows at once: a handle that goes far passes its
loop.
"""

from __future__ import annotations

from dataclasses import dataclass

from endolock.hw.api import Vector

CAUTION_S, CAUTIOUS_RAD = 1.0, (0.07, 0.15)
"""Time constant with which the target is followed while the model is not known [s], and offsets
from the axis up to which this holds and from which on it is followed at once [rad]. Assumed: more
than twice a latency of 0.4 s."""


@dataclass
class CautiousFollowing:
    """A place that follows the target slowly."""

    place: Vector | None = None
    """Followed place; None while nothing is followed [rad]."""
    t: float = 0.0
    """Time of that place [s]."""

    def follow(self, t: float, target: Vector, bend: Vector, off_rad: float) -> Vector:
        """Return the place to look at, 2 [rad].

        Args:
            t: present time [s].
            target: where the target is, 2 [rad].
            bend: present bend by the model, from where following starts, 2 [rad].
            off_rad: offset of the target from the axis [rad].
        """
        near, far = CAUTIOUS_RAD
        patience_s = CAUTION_S * min(max((far - off_rad) / (far - near), 0.0), 1.0)
        before = bend if self.place is None else self.place
        dt = max(t - self.t, 0.0) if self.place is not None else 0.0
        share = dt / max(dt, patience_s) if dt > 0 else 0.0
        self.place, self.t = before + share * (target - before), t
        return self.place

    def stop(self) -> None:
        """Follow nothing; the next call starts at the bend then."""
        self.place = None

    def move(self, by: Vector) -> None:
        """Shift the place by a change of the model, 2 [rad]."""
        if self.place is not None:
            self.place = self.place + by
