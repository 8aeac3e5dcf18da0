"""Fit of periodic curves: the least squares of their definition."""

from __future__ import annotations

import numpy as np
import pytest

from endolock.control.predictive.harmonic_fit import (
    OVERTONES,
    RIDGE,
    Sample,
    refined,
    residuals_of,
)
from endolock.control.predictive.place_history import WINDOW_S, PlaceHistory


def _past(count: int) -> PlaceHistory:
    random = np.random.default_rng(2)
    past = PlaceHistory()
    for t in np.cumsum(random.uniform(0.02, 0.06, count)).tolist():
        x, y = random.standard_normal(2).tolist()
        past.add(t, (float(np.sin(2 * np.pi * t / 3.3)) + 0.1 * x + 5.0, 0.1 * y))
    return past


@pytest.mark.parametrize("count", [110, 180])  # fewer than are thinned out
def test_residuals_are_those_of_weighted_least_squares(count: int) -> None:
    past, periods = _past(count), np.array([0.8, 2.1, 3.3])
    times = past.times - past.times[-1]
    root = np.exp(times / WINDOW_S)
    for period, found in zip(periods, residuals_of(Sample(past), periods), strict=True):
        phases = 2 * np.pi * times[:, None] / period * np.arange(1, OVERTONES + 1)
        curves = np.column_stack([np.ones(count), np.cos(phases), np.sin(phases)])
        for places, left in zip(past.places, found.tolist(), strict=True):
            apart = places - np.average(places, weights=root**2)
            best = np.linalg.lstsq(root[:, None] * curves, root * apart)[0]
            least = float(np.average((apart - curves @ best) ** 2, weights=root**2))
            assert least * (1 - 1e-9) <= left <= (least + RIDGE * float(best @ best)) * (1 + 1e-9)


def test_a_period_is_refined_to_that_of_the_curve() -> None:
    past = _past(180)
    period, _, left = refined(Sample(past), 0, 3.2, 4)
    assert period == pytest.approx(3.3, rel=0.02)  # noise of a tenth over two periods
    assert left == pytest.approx(0.1**2, rel=0.3)
