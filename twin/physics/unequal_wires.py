"""A pair of unequal wires: two generalised plays, whose loops differ between the two directions.

A wire can only pull. The one for positive angles moves the tip once the handle has taken up what
that wire loses in its conduit, p, and turns it by s_p per handle angle; the one for negative angles
loses n and has another pulley ratio, s_n. Of each of several strands in parallel, each with its own
friction, the output z stays between the lines of the two wires,

    s_p (h - p) <= z <= s_n (h + n)          bend = sum w_i z_i

so the loop is off centre by s (p - n)/2, and its width at the handle changes along the stroke,
p + n + z (1/s_p - 1/s_n). Both lines rise with the handle, so the bend never turns against it.

Reference:
    M. Al Janaideh, S. Rakheja and C.-Y. Su, IEEE/ASME Trans. Mechatronics 16(4), 2011.
"""

from __future__ import annotations

from dataclasses import dataclass

from endolock.twin.physics.foreign_plants import EqualAxes


@dataclass(frozen=True, kw_only=True)
class UnequalWires:
    """Both wires of an axis; both axes are alike and independent. All numbers are assumed."""

    positive_rad: tuple[float, ...] = (0.25, 0.45)
    """p_i, handle angle that the wire for positive angles loses, by strand [rad]."""
    negative_rad: tuple[float, ...] = (0.15, 0.25)
    """n_i, handle angle that the wire for negative angles loses, by strand [rad]."""
    weights: tuple[float, ...] = (0.5, 0.5)
    """w_i, share of each strand in the bend [1]."""
    positive_slope: float = 0.97
    """s_p, bend per handle angle while the wire for positive angles pulls [rad/rad]."""
    negative_slope: float = 0.87
    """s_n, bend per handle angle while the wire for negative angles pulls [rad/rad]."""

    def at_rest(self) -> EqualAxes:
        """Return both axes with the tip straight."""
        return EqualAxes(lambda: _Axis(self))


class _Axis:
    """State of one axis."""

    def __init__(self, made: UnequalWires) -> None:
        self._made, self.friction_times = made, 1.0
        self._outputs = [0.0] * len(made.weights)

    def follow(self, handle_rad: float) -> float:
        """Move the handle to an angle [rad]; return the bend [rad]."""
        made, times = self._made, self.friction_times
        lost = zip(made.positive_rad, made.negative_rad, strict=True)
        for n, (positive, negative) in enumerate(lost):
            least = made.positive_slope * (handle_rad - times * positive)
            most = made.negative_slope * (handle_rad + times * negative)
            self._outputs[n] = min(max(self._outputs[n], least), most)
        return sum(w * z for w, z in zip(made.weights, self._outputs, strict=True))
