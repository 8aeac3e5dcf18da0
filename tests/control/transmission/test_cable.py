"""Lumped nodes against the slip slopes and tension ratios of the whole cable."""

from math import exp, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.control.transmission.cable import SMALLEST, compliances, friction_ratios, slip_slopes

# a is the exponent of the conduit, b that of the section, as in the formulas of cable.py
A = st.floats(0.1, 3.0)  # below, the lower limits of the lumped form apply
B = st.floats(0.0, 1.0)
NODES = st.integers(1, 5)


@given(a=A, b=B, nodes=NODES)
def test_nodes_in_a_row_have_the_slip_slopes_of_the_whole_cable(
    a: float, b: float, nodes: int
) -> None:
    """While all nodes slide, tensions differ by e^(+-a/n), and at the last node by e^(+-b) more."""
    springs = compliances(a, b, nodes)
    assert len(springs) == nodes + 1
    for slope, sign in zip(slip_slopes(a, b), (1, -1), strict=True):
        tensions = [exp(sign * ((nodes - n) * a / nodes + b)) for n in range(nodes)] + [1.0]
        travel = sum(c * t for c, t in zip(springs, tensions, strict=True))
        # a/n = 0.02 at the least, where cosh a - 1 keeps 12 of its 16 digits
        assert travel == pytest.approx(slope, rel=1e-8)


@given(a=A, b=B, nodes=NODES)
def test_the_friction_bounds_are_the_capstan_ratio(a: float, b: float, nodes: int) -> None:
    product = np.prod([(1 + r) / (1 - r) for r in friction_ratios(a, b, nodes)])
    assert product == pytest.approx(exp(a + b), rel=1e-9)  # a + b < 4, little cancellation


@given(a=A, b=B)
def test_pulling_needs_more_travel_per_tension_than_releasing(a: float, b: float) -> None:
    pull, release = slip_slopes(a, b)
    assert pull > 1 > release > 0


@given(nodes=NODES, b=B)
def test_without_curvature_the_formulas_stay_finite(nodes: int, b: float) -> None:
    springs = compliances(0.0, b, nodes)
    assert all(0 < spring < pi for spring in springs)
    if b == 0:
        # the floor on a leaves each node's tanh(a/2)/(a/2)
        assert sum(springs) == pytest.approx(1.0, rel=SMALLEST**2)
