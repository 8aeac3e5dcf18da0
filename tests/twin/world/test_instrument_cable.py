"""Conversions between an instrument and the models of its transmission."""

from dataclasses import replace
from math import pi

import pytest

from endolock.twin.world import instrument_files
from endolock.twin.world.instrument_cable import cable_of, geometry_of, section_of, with_cable


@pytest.mark.parametrize("name", instrument_files.names())
@pytest.mark.parametrize("shaft_rad", [0.0, pi])
def test_an_instrument_with_its_own_cable_is_unchanged(name: str, shaft_rad: float) -> None:
    instrument = replace(instrument_files.load(name), slack_loss_m_per_rad=0.0)
    same = with_cable(instrument, cable_of(instrument, shaft_rad), shaft_rad)
    assert vars(same) == pytest.approx(vars(instrument), rel=1e-12)  # rounding


def test_the_cable_is_per_bending_stiffness() -> None:
    instrument = instrument_files.load("slack")
    stiff = replace(
        instrument,
        bending_stiffness=2 * instrument.bending_stiffness,
        wire_stiffness=2 * instrument.wire_stiffness,
        sheath_friction_nm=2 * instrument.sheath_friction_nm,
    )
    assert cable_of(stiff, pi) == cable_of(instrument, pi)


def test_both_geometries_have_the_lengths_of_the_instrument() -> None:
    instrument = replace(instrument_files.load("slack"), bending_length_m=0.06)
    assert geometry_of(instrument).bending_length_m == 0.06
    assert section_of(instrument).bending_length_m == 0.06
