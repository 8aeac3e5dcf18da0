"""Search for the period of each axis, in slices."""

from __future__ import annotations

import numpy as np
import pytest

from endolock.control.predictive.period_search import PeriodSearch
from endolock.control.predictive.place_history import PlaceHistory

FRAME_S = 0.04


def searched(first: float, second: float, seconds: float = 34.0) -> PeriodSearch:
    search, past = PeriodSearch(), PlaceHistory()
    for t in np.arange(0.0, seconds, FRAME_S).tolist():
        one, other = 2 * np.pi * t / first, 2 * np.pi * t / second
        place = (0.3 * (1 - np.cos(one)) + 0.05 * np.cos(2 * one), 0.1 * np.sin(other))
        past.add(t, (float(place[0]), float(place[1])))
        search.update(past, (1e-8, 1e-8))
        search.work()
        search.work()
    return search


@pytest.mark.parametrize(("first", "second"), [(3.3, 0.85), (8.6, 10.1), (14.0, 5.0)])
def test_the_period_of_each_axis_is_found_and_not_its_multiple(first: float, second: float) -> None:
    fits = searched(first, second).fits
    for fit, period in zip(fits, (first, second), strict=True):
        assert fit is not None
        assert fit.period_s == pytest.approx(period, rel=1e-3)  # Gauss-Newton, no noise
    assert fits[1] is not None
    assert fits[1].at(35.0) == pytest.approx(0.1 * np.sin(2 * np.pi * 35.0 / second), abs=1e-3)


def test_a_period_longer_than_the_past_is_not_claimed() -> None:
    for fit in searched(14.0, 12.0, 10.0).fits:
        assert fit is None or fit.period_s < 10.0


def test_a_constant_moves_the_curve_even_during_a_round() -> None:
    search, past = PeriodSearch(), PlaceHistory()
    for n in range(800):
        t = n * FRAME_S
        moved = 0.2 if n >= 700 else 0.0
        if n == 700:
            past.move((0.2, 0.2))
            search.move((0.2, 0.2))
        x = float(0.1 * np.sin(2 * np.pi * t / 6.0)) + moved
        past.add(t, (x, x))
        search.update(past, (1e-8, 1e-8))
        search.work()
        search.work()
        for fit in search.fits:
            # 10 s: a period and the first round; 0.01 px = 2.6e-5 rad is far below any noise
            assert n < 350 or (fit is not None and abs(fit.at(t) - x) < 1e-3)
