"""Kalman filters of one axis: closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.control.predictive.axis_filters import AxisFilter

FRAME_S = 0.04


@given(speed=st.floats(-1, 1), start=st.floats(-1, 1))
@settings(deadline=None)
def test_constant_velocity_is_predicted_exactly(speed: float, start: float) -> None:
    moving = AxisFilter(0.5)
    for t in np.arange(0.0, 6.0, FRAME_S).tolist():
        moving.update(t, start + speed * t, 1e-8)
    # the remainder of the initial guess of no motion after 150 frames
    assert moving.ahead(1.0) == pytest.approx(start + speed * (6.0 - FRAME_S + 1.0), abs=1e-3)


def test_the_filter_settles_at_the_kalman_gain() -> None:
    import control as ct

    moving, q, r = AxisFilter(0.3), 0.3, 1e-4
    for n in range(400):
        moving.update(n * FRAME_S, 0.0, r)
    phi = np.array([[1.0, FRAME_S], [0.0, 1.0]])
    driven = q * np.array([[FRAME_S**3 / 3, FRAME_S**2 / 2], [FRAME_S**2 / 2, FRAME_S]])
    _, before, _ = ct.dlqe(phi, np.eye(2), np.array([[1.0, 0.0]]), driven, np.array([[r]]))
    after = before[0, 0] * r / (before[0, 0] + r)
    assert moving.covariance[0] == pytest.approx(after, rel=1e-6)  # the same Riccati equation


def test_a_random_walk_has_no_velocity() -> None:
    still = AxisFilter(0.02, still=True)
    for n in range(100):
        still.update(n * FRAME_S, 0.1 * n, 1e-6)
    assert still.ahead(1.0) == still.ahead(0.0) == pytest.approx(9.9, abs=1e-3)
