"""Converts between an instrument and the models of its transmission and section.

The models of control/transmission are per bending stiffness K and hold at one bend of the shaft.
Two of their parameters depend on that bend: the capstan exponent of the conduit, friction
coefficient times wrap angle, and the free length of the wires.
"""

from __future__ import annotations

from dataclasses import replace

from endolock.control.transmission.both_axes import CableTransmission
from endolock.control.transmission.kinematics import SectionGeometry
from endolock.control.transmission.quasi_static import Cable, Geometry
from endolock.twin.world.instrument import Instrument, Numerics


def cable_of(instrument: Instrument, shaft_rad: float) -> Cable:
    """Return the wires and conduits of an instrument, per bending stiffness.

    Args:
        instrument: its parameters.
        shaft_rad: bend of the shaft [rad].
    """
    stiffness = instrument.bending_stiffness
    return Cable(
        conduit_exponent=instrument.conduit_exponent_at(shaft_rad),
        section_friction=instrument.section_friction,
        stiffness=instrument.wire_stiffness / stiffness,
        slack_m=instrument.slack_at(shaft_rad),
        sheath=instrument.sheath_friction_nm / stiffness,
    )


def geometry_of(instrument: Instrument, hinges: int = Numerics().hinges) -> Geometry:
    """Return the geometry of an instrument for the quasi-static solver.

    Args:
        instrument: its parameters.
        hinges: number of hinges of the section, both axes together.
    """
    return Geometry(
        bending_length_m=instrument.bending_length_m,
        wire_radius_m=instrument.wire_radius_m,
        pulley_radius_m=instrument.pulley_radius_m,
        hinges=hinges,
    )


def transmission_of(instrument: Instrument, shaft_rad: float) -> CableTransmission:
    """Return the quasi-static transmission of an instrument.

    Args:
        instrument: its parameters.
        shaft_rad: bend of the shaft [rad].
    """
    return CableTransmission(
        cable=cable_of(instrument, shaft_rad), geometry=geometry_of(instrument)
    )


def section_of(instrument: Instrument) -> SectionGeometry:
    """Return the lengths of an instrument's section."""
    return SectionGeometry(
        bending_length_m=instrument.bending_length_m,
        rigid_tip_m=instrument.rigid_tip_m,
        misalignment_rad=instrument.misalignment_rad,
    )


def with_cable(
    base: Instrument, cable: Cable, shaft_rad: float, bending_stiffness: float | None = None
) -> Instrument:
    """Return an instrument with another cable, the inverse of `cable_of`.

    Args:
        base: gives everything that the cable does not: geometry, residual wrap, motors.
        cable: wires and conduits at that bend of the shaft.
        shaft_rad: bend of the shaft [rad].
        bending_stiffness: K [N m/rad]; that of the base if None.
    """
    stiffness = bending_stiffness or base.bending_stiffness
    return replace(
        base,
        bending_stiffness=stiffness,
        wire_stiffness=cable.stiffness * stiffness,
        slack_m=cable.slack_m,
        slack_loss_m_per_rad=0.0,
        conduit_friction=cable.conduit_exponent / base.wrap_at(shaft_rad),
        section_friction=cable.section_friction,
        sheath_friction_nm=cable.sheath * stiffness,
    )
