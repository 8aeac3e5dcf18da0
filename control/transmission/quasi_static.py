"""Quasi-static model of one axis of a bending section and its wires, without inertia or damping.

Each wire is cut once, as in control/transmission/cable.py: handle - spring - node - spring -
section. All quantities are per bending stiffness K, so tensions are in 1/m. With x the node's
travel towards the handle and g(theta) the length of the wire in the section less its free length,

    t_p = k_p max(0, +-r_p phi - x)         t_w = k_w max(0, x + g(theta))
    e^-S <= t_p/t_w <= e^S                  the node sticks, or slides by the least amount
    theta + m(theta) = sum over the wires of t_w (+-r cos(q/2) + h/2 sin(q/2)),   q = theta/n

where m is the dry friction of the sheath, modelled as a yielding elastic spring. The right side
falls and the left side rises with theta, so each handle angle and history gives one bend. The wires
of the other axis have no lever r; under pretension they still shorten with the bend and support it.

S and the springs are taken at the bend extrapolated from the last step: with steps of a degree or
two that is as accurate as solving for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import cos, exp, hypot, inf, pi, sin

from endolock.control.transmission.cable import compliances
from endolock.hw.api import ConfigError

TOLERANCE_RAD = 1e-9
"""Error of a bend [rad], far below any noise."""
FLAT = 1e-3
"""Slope used where the handle moves no wire [1]: far below any other slope, but not 0."""
LARGEST_SLACK_M = 1.0
LARGEST_EXPONENT = 100.0
"""Largest free length of a wire [m] and capstan exponent [1]. Assumed."""
SHEATH_GIVE_RAD = 0.02
"""Elastic bend of a sheath with dry friction before it slides [rad]; also the twin's. Assumed."""


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """Dimensions of section and pulley, which can be measured or counted."""

    bending_length_m: float = 0.075
    """L, along the backbone [m], > 0."""
    wire_radius_m: float = 0.0042
    """r, wire holes to the backbone [m], > 0."""
    pulley_radius_m: float = 0.005
    """r_p, wire travel per handle angle [m/rad], > 0."""
    hinges: int = 12
    """N, both axes together, even; each ring turns by 1/(N/2) of the bend."""

    def __post_init__(self) -> None:
        lengths = (self.bending_length_m, self.wire_radius_m, self.pulley_radius_m)
        if not all(0 < length <= 1 for length in lengths) or self.hinges not in range(2, 101, 2):
            raise ConfigError(
                f"geometry {self}",
                "use lengths above 0 and an even number of hinges, in metres and up to 100",
            )


@dataclass(frozen=True, kw_only=True)
class Cable:
    """Wires and conduits, per bending stiffness K; the same for all wires."""

    conduit_exponent: float
    """Capstan exponent mu Theta of the conduit at the shaft's bend, residual wrap included [1],
    >= 0."""
    section_friction: float
    """mu_b of the bending section [1], >= 0."""
    stiffness: float
    """k/K of wire and conduit, end to end [1/m2], > 0."""
    slack_m: float
    """Free length of each wire [m]; negative is pretension."""
    sheath: float
    """Dry friction of the sheath over K [rad], >= 0."""

    def __post_init__(self) -> None:
        shares = (self.conduit_exponent, self.section_friction, self.sheath)
        if not (all(0 <= x < inf for x in shares) and 0 < self.stiffness < inf):
            raise ConfigError(f"{self}", "use finite numbers of 0 or more, a stiffness above 0")
        if not abs(self.slack_m) <= LARGEST_SLACK_M or self.conduit_exponent > LARGEST_EXPONENT:
            raise ConfigError(
                f"{self}",
                f"use slack_m of {-LARGEST_SLACK_M:g} to {LARGEST_SLACK_M:g} m, conduit_exponent "
                f"up to {LARGEST_EXPONENT:g}",
            )


class Axis:
    """State of one axis, updated with each handle angle.

    Args:
        cable: wires and conduits.
        geometry: dimensions of the section.
    """

    def __init__(self, cable: Cable, geometry: Geometry) -> None:
        self._made = self._cable = cable
        self._geometry = geometry
        self.bend_rad = 0.0
        """Present bend [rad]."""
        self.tensions = (0.0, 0.0)
        """Present tensions at the handle over K [1/m]: of the wire pulled by a positive angle, and
        of the opposite one."""
        near, far = compliances(cable.conduit_exponent, 0.0)
        self._nodes = [min(0.0, cable.slack_m) * near / (near + far)] * 4  # both springs pull alike
        self._yielded = self._step_rad = self._handle_rad = 0.0

    @property
    def state(self) -> list[float]:
        """The complete state except the tensions; setting it continues from there."""
        return [self.bend_rad, self._yielded, self._step_rad, self._handle_rad, *self._nodes]

    @state.setter
    def state(self, values: Sequence[float]) -> None:
        self.bend_rad, self._yielded, self._step_rad, self._handle_rad, *self._nodes = values

    def rub(self, times: float) -> None:
        """Set the friction of conduit and section to a multiple of the one it was made with [1]."""
        made = self._made
        self._cable = replace(
            made,
            conduit_exponent=times * made.conduit_exponent,
            section_friction=times * made.section_friction,
        )

    def follow(
        self, handle_rad: float, other_handle_rad: float = 0.0, other_bend_rad: float = 0.0
    ) -> float:
        """Move the handle to an angle; return the bend [rad].

        Args:
            handle_rad: handle angle [rad]; steps of a few hundredths are accurate.
            other_handle_rad: handle angle of the other axis [rad]; its wires cross the bend and,
                under tension, support it.
            other_bend_rad: present bend of the other axis [rad].
        """
        cable = self._cable
        k_p, k_w, ratios = self._stiffness(self.bend_rad + self._step_rad, other_bend_rad)
        own_travel = self._geometry.pulley_radius_m * handle_rad
        other_travel = self._geometry.pulley_radius_m * other_handle_rad
        across, along = self._crossing(other_bend_rad)

        # node, travel, side and constant length of each wire, those of the axis first
        wires = [
            (self._nodes[0], own_travel, -1.0, 0.0),
            (self._nodes[1], -own_travel, 1.0, 0.0),
            (self._nodes[2], other_travel, 0.0, -across),
            (self._nodes[3], -other_travel, 0.0, across),
        ]
        lengths, friction, give_rad = self._lengths, cable.sheath, SHEATH_GIVE_RAD

        def balance(bend: float) -> tuple[float, float]:
            """Residual moment at a bend, and its slope."""
            sheath = (bend - self._yielded) * friction / give_rad
            missing, slope = bend, 1.0
            if abs(sheath) < friction:
                missing, slope = missing + sheath, slope + friction / give_rad
            else:
                missing += friction if sheath > 0 else -friction
            middle, side, lever, arm = lengths(bend)
            middle += along
            for node, travel, way, more in wires:
                gap = middle + way * side + more
                x, sliding = _slide(node, travel, gap, ratios)
                if x + gap <= 0:
                    continue
                pull = lever - way * arm
                missing -= k_w * (x + gap) * pull
                # a sliding node follows by dx/dgap = -ratio/(1 + ratio)
                slope += k_w * pull * pull * (1.0 if sliding is None else 1 / (1 + sliding))
            return missing, slope

        bend = _root(balance, self.bend_rad + self._step_rad)
        self._handle_rad = handle_rad
        self._step_rad, self.bend_rad = bend - self.bend_rad, bend
        give = bend - self._yielded
        if abs(give) > SHEATH_GIVE_RAD:
            self._yielded = bend - (SHEATH_GIVE_RAD if give > 0 else -SHEATH_GIVE_RAD)
        tensions = []
        middle, side, _, _ = lengths(bend)
        for wire, (node, travel, way, more) in enumerate(wires):
            x, _ = _slide(node, travel, middle + along + way * side + more, ratios)
            self._nodes[wire] = x
            tensions.append(k_p * max(0.0, travel - x))
        self.tensions = (tensions[0], tensions[1])
        return bend

    def handle_for(
        self, bend_rad: float, other_handle_rad: float = 0.0, other_bend_rad: float = 0.0
    ) -> float:
        """Handle angle that gives a bend from the present state, which stays unchanged [rad].

        Args:
            bend_rad: desired bend [rad], different from the present one, which a range of handle
                angles gives.
            other_handle_rad: handle angle of the other axis [rad].
            other_bend_rad: present bend of the other axis [rad].
        """
        cable = self._cable
        _, k_w, ratios = self._stiffness(bend_rad, other_bend_rad)
        across, along = self._crossing(other_bend_rad)
        middle, side, lever, arm = self._lengths(bend_rad)
        gap, radius = middle + along, self._geometry.pulley_radius_m
        sheath = (bend_rad - self._yielded) * cable.sheath / SHEATH_GIVE_RAD
        fixed = bend_rad + min(max(sheath, -cable.sheath), cable.sheath)
        other_travel = radius * other_handle_rad
        for node, travel, away in (
            (self._nodes[2], other_travel, gap - across),
            (self._nodes[3], -other_travel, gap + across),
        ):
            x, _ = _slide(node, travel, away, ratios)
            fixed -= k_w * max(0.0, x + away) * lever
        own = (
            (self._nodes[0], radius, gap - side, lever + arm),
            (self._nodes[1], -radius, gap + side, lever - arm),
        )

        def balance(handle: float) -> tuple[float, float]:
            """Excess moment at a handle angle, and its slope."""
            excess, slope = -fixed, 0.0
            for node, per_rad, away, arm in own:
                x, sliding = _slide(node, per_rad * handle, away, ratios)
                if x + away <= 0:
                    continue
                excess += k_w * (x + away) * arm
                if sliding is not None:
                    slope += k_w * arm * per_rad / (1 + sliding)
            return excess, max(slope, FLAT)

        return _root(balance, self._handle_rad)

    def _stiffness(
        self, bend_rad: float, other_bend_rad: float
    ) -> tuple[float, float, tuple[float, float]]:
        """Stiffness on either side of the nodes, and k_w e^(+-S)/k_p."""
        cable = self._cable
        b = cable.section_friction * hypot(bend_rad, other_bend_rad)
        near, far = compliances(cable.conduit_exponent, b)
        k_p, k_w = cable.stiffness / near, cable.stiffness / far
        up = exp(cable.conduit_exponent + b)
        return k_p, k_w, (k_w * up / k_p, k_w / up / k_p)

    def _lengths(self, bend: float) -> tuple[float, float, float, float]:
        """Length of the centre line, change of wire length by side, and the two levers."""
        geometry = self._geometry
        n, r = geometry.hinges / 2, geometry.wire_radius_m
        h = geometry.bending_length_m / geometry.hinges
        c, s = cos(bend / n / 2), sin(bend / n / 2)
        return n * h * c, n * 2 * r * s, h / 2 * s, r * c

    def _crossing(self, other_bend: float) -> tuple[float, float]:
        """Length that the other axis' bend adds to its own wires by side, and to all wires."""
        middle, side, _, _ = self._lengths(other_bend)
        return side, middle - self._geometry.bending_length_m - self._cable.slack_m


def _slide(
    x: float, travel: float, gap: float, ratios: Sequence[float]
) -> tuple[float, float | None]:
    """Position where a node comes to rest, and the ratio k_w e^(+-S)/k_p if it slides."""
    if travel + gap <= 0:  # slack: it rests where neither side pulls
        return min(max(x, travel), -gap), None
    up, down = ratios
    low = (travel - up * gap) / (1 + up)
    if x < low:
        return low, up
    high = (travel - down * gap) / (1 + down)
    return (high, down) if x > high else (x, None)


def _root(balance: Callable[[float], tuple[float, float]], start: float) -> float:
    """Root of a rising, piecewise smooth function: Newton steps within a bracket."""
    low, high, at = -pi, pi, start
    for _ in range(60):
        missing, slope = balance(at)
        if abs(missing) < TOLERANCE_RAD * slope:
            return at
        if missing > 0:
            high = at
        else:
            low = at
        at -= missing / slope
        if not low < at < high:
            at = (low + high) / 2
    return at
