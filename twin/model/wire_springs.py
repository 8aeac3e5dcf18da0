"""Springs and rest state of the wires: what a built model starts with.

Each wire is cut into springs and friction nodes (`physics/wire_friction.py`); their stiffness and
friction follow from `control/transmission/cable.py`.
"""

from __future__ import annotations

from endolock.control.transmission import cable
from endolock.twin.world.instrument import Instrument

LEAST_FRICTION_N = 1e-6
"""Friction bound of a node without tension [N]: zero would remove its row from the solver."""


def spring_stiffness(
    instrument: Instrument, nodes: int, shaft_bend_rad: float, bend_rad: float
) -> list[float]:
    """Return the stiffness of the nodes + 1 springs of one wire from handle to section [N/m].

    Args:
        instrument: parameters of wire and conduit.
        nodes: friction nodes per wire.
        shaft_bend_rad: bend of the shaft [rad].
        bend_rad: magnitude of the bend of the section [rad], >= 0.
    """
    k = instrument.wire_stiffness
    conduit_exponent = instrument.conduit_exponent_at(shaft_bend_rad)
    section_exponent = instrument.section_friction * bend_rad
    return [k / c for c in cable.compliances(conduit_exponent, section_exponent, nodes)]


def rest_slides(instrument: Instrument, nodes: int, shaft_bend_rad: float) -> list[float]:
    """Return the positions of the friction nodes of a wire at rest [m].

    All its springs have the same tension, and the handles are at zero.

    Args:
        instrument: parameters of wire and conduit.
        nodes: friction nodes per wire.
        shaft_bend_rad: bend of the shaft [rad].
    """
    compliance = [1 / k for k in spring_stiffness(instrument, nodes, shaft_bend_rad, 0.0)]
    strain = min(0.0, instrument.slack_at(shaft_bend_rad)) / sum(compliance)
    return [strain * sum(compliance[: n + 1]) for n in range(nodes)]


def rest_friction(instrument: Instrument, nodes: int) -> list[float]:
    """Return the friction bounds of the nodes of a wire at rest, shaft straight [N]."""
    stretch = -rest_slides(instrument, nodes, 0.0)[0]
    tension = stretch * spring_stiffness(instrument, nodes, 0.0, 0.0)[0]
    ratios = cable.friction_ratios(instrument.conduit_exponent_at(0.0), 0.0, nodes)
    return [max(ratio * 2 * tension, LEAST_FRICTION_N) for ratio in ratios]
