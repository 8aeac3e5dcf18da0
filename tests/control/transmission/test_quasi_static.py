"""The quasi-static axis against the closed form and against the independent MuJoCo twin."""

from dataclasses import replace
from itertools import pairwise
from math import degrees, pi, radians

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.control.transmission.quasi_static import Axis, Cable, Geometry
from endolock.control.transmission.simulation import simulate
from endolock.hw.api import ConfigError, Vector
from endolock.scripts.checks.strokes import still, turn
from endolock.twin.physics.closed_forms import PulledSection
from endolock.twin.world import instrument_files
from endolock.twin.world.instrument import NUMERICS, Instrument, Numerics
from endolock.twin.world.instrument_cable import cable_of

TIGHT = Cable(
    conduit_exponent=0.66, section_friction=0.2, stiffness=8e4, slack_m=-3e-3, sheath=0.05
)


def _alone(cable: Cable, handle: Vector, hinges: int = 12) -> tuple[Vector, Vector]:
    still_there = np.zeros(len(handle))
    return simulate(cable, Geometry(hinges=hinges), handle, still_there, still_there)


OTHERS = sorted({*instrument_files.names()} - {"slack", "two_region"})


@pytest.mark.parametrize(
    "name",
    ["slack", "two_region", *(pytest.param(name, marks=pytest.mark.slow) for name in OTHERS)],
)
def test_a_twin_with_fewer_hinges_moves_the_same(name: str) -> None:
    """With the hinges of `fast`; the usual number is one of the checks of the model card."""
    instrument, numerics = instrument_files.load(name), NUMERICS["fast"]
    plant = still(instrument, numerics, shaft_deg=180.0)
    motion = turn(plant, [(0, 0), (20, 2.0), (60, -2.0), (100, 2.0), (112, 0.8), (120, 1.6)])
    every = slice(None, None, 10)
    bends, tensions = _alone(cable_of(instrument, pi), motion.handle[every], numerics.hinges)
    # damping at 0.1 rad/s, and a row of 0.01 rad: a quarter of a percent of the range
    assert degrees(np.abs(bends - motion.bend[every]).max()) < 0.2
    pulls = instrument.bending_stiffness * tensions
    measured = np.column_stack([motion.proximal, motion.opposite])[every]
    assert pulls == pytest.approx(measured, abs=0.2)  # of some 30 N


def test_the_other_axis_matters() -> None:
    """Its handle moves first; its wires cross the bend and its bend adds to the friction."""
    instrument = Instrument()
    plant = still(instrument)
    other = turn(plant, [(0, 0), (15, 1.2)], axis=1)
    start = turn(plant, [(0, 0), (0.02, 0.0)])
    motion = turn(plant, [(0, 0), (20, 1.6), (50, -1.6), (80, 1.6)])
    axis = Axis(cable_of(instrument, pi), Geometry())
    for handle, bend in zip(other.handle[::10], other.bend[::10], strict=True):
        axis.follow(0.0, handle, bend)
    beside = 1.2, float(other.bend[-1])
    bends = [axis.follow(angle, *beside) for angle in (start.handle[-1], *motion.handle[::10])]
    # the held axis yields by a degree or two meanwhile, which a bench would measure and pass
    assert np.abs(np.degrees(bends[1:] - motion.bend[::10])).max() < 1.5


@pytest.mark.parametrize("pulling", [True, False])
def test_one_wire_follows_the_closed_form(pulling: bool) -> None:
    one = Instrument(slack_m=0.0005)
    section = PulledSection(one, Numerics().hinges, pi)
    stroke = np.arange(0, 1.5, 0.002)
    handle = stroke if pulling else np.append(stroke, stroke[::-1])
    bends, _ = _alone(cable_of(one, pi), handle)
    rows = (bends > 0.2) & (bends < 0.8 * bends.max())
    rows &= np.arange(len(bends)) < len(stroke) if pulling else np.arange(len(bends)) > len(stroke)
    right = section.handle(bends[rows], pulling=pulling)
    assert handle[rows] == pytest.approx(right, rel=1e-4)  # steps of 0.002 in b


@settings(max_examples=20)
@given(corners=st.lists(st.floats(-2.0, 2.0), min_size=2, max_size=6))
def test_only_the_path_counts_and_mirroring_holds(corners: list[float]) -> None:
    points = [0.0, *corners]
    coarse, fine = (
        np.concatenate(
            [np.linspace(a, b, max(2, round(abs(b - a) / step) + 1)) for a, b in pairwise(points)]
        )
        for step in (0.02, 0.002)
    )
    ends = [_alone(TIGHT, handle)[0][-1] for handle in (coarse, fine)]
    assert ends[0] == pytest.approx(ends[1], abs=radians(0.35))  # b from the last step of 0.02
    assert _alone(TIGHT, -fine)[0][-1] == pytest.approx(-ends[1], abs=1e-6)  # rounding, kinks


def test_two_axes_share_no_state() -> None:
    first, second = Axis(TIGHT, Geometry()), Axis(TIGHT, Geometry())
    first.follow(1.0)
    assert second.bend_rad == 0.0
    assert second.follow(0.0) == pytest.approx(0.0, abs=1e-9)


def test_without_friction_there_is_no_loop() -> None:
    smooth = replace(TIGHT, conduit_exponent=0.0, section_friction=0.0, sheath=0.0)
    stroke = np.linspace(-1.5, 1.5, 151)
    out, back = _alone(smooth, np.concatenate([stroke, stroke[::-1]]))[0].reshape(2, -1)
    assert out == pytest.approx(back[::-1], abs=1e-6)


@pytest.mark.parametrize("change", [{"wire_radius_m": 0.0}, {"hinges": 3}, {"hinges": 0}])
def test_impossible_geometry_is_refused(change: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="use lengths above 0 and an even number of hinges"):
        Geometry(**change)  # type: ignore[arg-type]
