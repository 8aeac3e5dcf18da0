"""Closed forms and solvers that verify the twin; they share nothing with MuJoCo.

The bending section has N hinges of pitch h = L/N, alternating between the axes, wire holes at
radius r midway between them, and stiffness K N/2 per hinge, so that n = N/2 hinges of an axis bend
by q = theta/n each under the same moment K theta. Over one hinge, a wire in the plane of the
bend is h cos(q/2) -+ 2 r sin(q/2) long, a wire out of it h cos(q/2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from endolock.control.transmission import cable
from endolock.hw.api import Vector
from endolock.twin.world.instrument import Instrument

DOWN = np.array([0.0, 0.0, -9.81])
"""Gravity in world axes (distal, left, up) [m/s2]."""


@dataclass(frozen=True)
class PulledSection:
    """A section bent in one plane by one wire; the other three are slack.

    Args:
        instrument: its parameters, without pretension and sheath friction.
        hinges: N, even.
        shaft_bend_rad: bend of the shaft [rad].
    """

    instrument: Instrument
    hinges: int
    shaft_bend_rad: float

    def pull(self, bend_rad: Vector) -> Vector:
        """Return the wire that a bend takes up [m]: L - n (h cos(q/2) - 2 r sin(q/2)) - n h."""
        h, q = self._pitch_and_angle(bend_rad)
        r, n = self.instrument.wire_radius_m, self.hinges / 2
        return np.asarray(n * (h - h * np.cos(q / 2) + 2 * r * np.sin(q / 2)))

    def tension(self, bend_rad: Vector) -> Vector:
        """Return the tension at the section that holds the bend [N], K theta over the lever arm.

        The lever arm of the wire is r cos(q/2) + h/2 sin(q/2).
        """
        h, q = self._pitch_and_angle(bend_rad)
        lever = self.instrument.wire_radius_m * np.cos(q / 2) + h / 2 * np.sin(q / 2)
        return np.asarray(self.instrument.bending_stiffness * bend_rad / lever)

    def stretch(self, tension_n: Vector, bend_rad: Vector, *, pulling: bool) -> Vector:
        """Return the stretch of the cable while all of it slides, T/k {A or B} [m]."""
        slopes = [self._slopes(bend)[0 if pulling else 1] for bend in bend_rad]
        return np.asarray(tension_n / self.instrument.wire_stiffness * slopes)

    def handle(self, bend_rad: Vector, *, pulling: bool) -> Vector:
        """Return the handle angle while the wire slides [rad]: (slack + pull + stretch)/r_p."""
        stretch = self.stretch(self.tension(bend_rad), bend_rad, pulling=pulling)
        travel = self.instrument.slack_at(self.shaft_bend_rad) + self.pull(bend_rad) + stretch
        return np.asarray(travel / self.instrument.pulley_radius_m)

    def distal_tensions(self, handle_rad: Vector, bend_rad: Vector) -> Vector:
        """Return the tension at the section along a handle motion [N], T = clip(T, k d/A, k d/B).

        d is the travel of the handle beyond slack and bend. Exact if the tip only follows the wire.
        """
        slack = self.instrument.slack_at(self.shaft_bend_rad)
        travel = self.instrument.pulley_radius_m * handle_rad - slack - self.pull(bend_rad)
        tension, found = 0.0, []
        for d, bend in zip(travel, bend_rad, strict=True):
            pulling, releasing = self._slopes(bend)
            force = max(0.0, self.instrument.wire_stiffness * d)
            tension = min(max(tension, force / pulling), force / releasing)
            found.append(tension)
        return np.array(found)

    def _pitch_and_angle(self, bend_rad: Vector) -> tuple[float, Vector]:
        return self.instrument.bending_length_m / self.hinges, bend_rad / (self.hinges / 2)

    def _slopes(self, bend_rad: float) -> tuple[float, float]:
        return cable.slip_slopes(
            self.instrument.conduit_exponent_at(self.shaft_bend_rad),
            self.instrument.section_friction * abs(bend_rad),
        )


def reversal(conduit_exponent: float, peak_n: float, nodes: int) -> tuple[Vector, Vector]:
    """Return the tension at the handle after a reversal, before the far end of the cable moves.

    When the wire slides back up to a depth x of its conduit (0 to 1), and the rest still has the
    tension T = peak e^(-a s), the tension at the handle is peak e^(-2 a x), after a travel of
    (peak/a) (1 - e^(-a x))^2 / k. Nodes slide one after the other: they meet that curve at x = 0,
    1/n, 2/n ... 1 and go straight in between.

    Args:
        conduit_exponent: capstan exponent a of the conduit [1], > 0.
        peak_n: tension at the handle before the reversal [N].
        nodes: number n of nodes.

    Returns:
        Travel at the handle times k [N], and tension at the handle [N], at the n + 1 corners.
    """
    a, x = conduit_exponent, np.arange(nodes + 1) / nodes
    return peak_n / a * (1 - np.exp(-a * x)) ** 2, peak_n * np.exp(-2 * a * x)


def static_hinges(
    instrument: Instrument, hinges: int, handles: tuple[float, float], *, gravity: bool
) -> Vector:
    """Return the hinge angles at rest of a section without friction, from the balance of moments.

    Args:
        instrument: its parameters; friction and sheath are ignored.
        hinges: N, even.
        handles: (up_down, left_right) [rad].
        gravity: whether the section has weight.

    Returns:
        N angles from base to tip, up_down and left_right in turn [rad].
    """
    h, r = instrument.bending_length_m / hinges, instrument.wire_radius_m
    axes = np.tile([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0]], (hinges // 2, 1))
    own = np.arange(hinges) % 2
    mass = np.full(hinges, instrument.section_mass_kg / hinges)

    def weight_moments(q: Vector) -> Vector:
        """Return the moments of the weight about the hinges [N m]."""
        rotation, position = np.eye(3), np.array([h / 2, 0.0, 0.0])
        pivots, turned, centres = [], [], []
        for n in range(hinges):
            turned.append(rotation @ axes[n])
            pivots.append(position)
            rotation = rotation @ Rotation.from_rotvec(q[n] * axes[n]).as_matrix()
            centres.append(position + rotation @ [h / 2, 0.0, 0.0])
            position = position + rotation @ [h, 0.0, 0.0]
        # the tip's weight lies midway between the ends of its cylinder, see section.py
        end = position - rotation @ [h / 2, 0.0, 0.0]
        centres.append(end + rotation @ [(0.4 * h + instrument.rigid_tip_m - 0.001) / 2, 0.0, 0.0])
        weight = np.append(mass, instrument.tip_mass_kg)[:, None] * DOWN
        return np.array(
            [
                np.cross(np.array(centres[n:]) - pivots[n], weight[n:]).sum(axis=0) @ turned[n]
                for n in range(hinges)
            ]
        )

    def moments(q: Vector) -> Vector:
        """Return the sum of all moments about the hinges [N m]; zero at rest."""
        total = -instrument.bending_stiffness * hinges / 2 * q
        across = h * np.cos(q / 2)
        for axis in (0, 1):
            for sign in (1.0, -1.0):  # a wire, and the one opposite
                mine = own == axis
                length = np.where(mine, across - sign * 2 * r * np.sin(q / 2), across).sum()
                pulled = sign * instrument.pulley_radius_m * handles[axis]
                stretch = pulled + length - instrument.bending_length_m - instrument.slack_m
                tension = instrument.wire_stiffness * max(0.0, stretch)
                slope = np.where(mine, -sign * r * np.cos(q / 2), 0.0) - h / 2 * np.sin(q / 2)
                total = total - tension * slope
        return total + weight_moments(q) if gravity else total

    found = root(moments, np.zeros(hinges), tol=1e-14)
    return np.asarray(found.x)
