"""Uncertainties of a fit against the closed form, and without information."""

from math import isfinite, sqrt

import numpy as np
import pytest

from endolock.control.identification.uncertainty import DETERMINED, Spread
from endolock.hw.api import Vector

N = 4000
RANDOM = np.random.default_rng(0)
WHITE = 0.3 * RANDOM.standard_normal(N)
RAMP = np.linspace(-1.0, 1.0, N)
NAMES = ("offset", "slope")
LINE = np.column_stack([np.ones(N), RAMP])


def _spread(
    jacobian: Vector,
    residuals: Vector = WHITE,
    *,
    stuck: tuple[bool, bool] = (False, False),
    model_error: float = 0.0,
) -> Spread:
    return Spread(
        names=NAMES,
        residuals=residuals,
        jacobian=jacobian,
        scale=(1.0, 1.0),
        stuck=stuck,
        model_error=model_error,
    )


def test_white_noise_gives_the_textbook_value_of_a_line() -> None:
    spread = _spread(LINE)
    assert spread.parameter(1.0, {"offset": 1.0}).std == pytest.approx(0.3 / sqrt(N), rel=0.1)
    # the variance of a slope over +-1 is 3/N; 10 %: noise of 4000 rows and their correlation
    assert spread.parameter(1.0, {"slope": 1.0}).std == pytest.approx(0.3 * sqrt(3 / N), rel=0.1)


def test_it_does_not_depend_on_units() -> None:
    milli = Spread(
        names=NAMES,
        residuals=WHITE,
        jacobian=LINE * [1.0, 1e-3],
        scale=(1.0, 1e3),
        stuck=(False, False),
        model_error=0.1,
    )
    usual = _spread(LINE, model_error=0.1).parameter(1.0, {"slope": 1.0}).std
    assert milli.parameter(1e3, {"slope": 1.0}).std == pytest.approx(1e3 * usual)  # rounding


def test_correlated_noise_counts_more() -> None:
    """A moving average over m rows leaves N/m that are independent."""
    slow = np.convolve(RANDOM.standard_normal(N + 19), np.full(20, 1 / sqrt(20)), "valid")
    fast = slow[RANDOM.permutation(N)]
    stds = [_spread(LINE, off).parameter(1.0, {"offset": 1.0}).std for off in (fast, slow)]
    # sqrt(20), or sqrt(39) from the correlation of neighbours alone, which Spread uses
    assert sqrt(20) * 0.8 < stds[1] / stds[0] < sqrt(39) * 1.2


def test_a_model_error_does_not_average_out() -> None:
    once = _spread(LINE, model_error=1.0).parameter(1.0, {"offset": 1.0}).std
    assert once == pytest.approx(1.0, rel=0.01)  # all of it is an offset; the noise is 0.005


@pytest.mark.parametrize("jacobian", [np.column_stack([RAMP, RAMP]), np.zeros((N, 2))])
def test_a_parameter_without_effect_is_not_determined(jacobian: Vector) -> None:
    """Two parameters of which only the sum has an effect, and two without effect."""
    for name in NAMES:
        parameter = _spread(jacobian).parameter(1.0, {name: 1.0})
        assert isfinite(parameter.std)
        assert parameter.std > 1e3
        assert not parameter.determined


def test_the_sum_of_two_can_be_determined_where_neither_is() -> None:
    parameter = _spread(np.column_stack([RAMP, RAMP])).parameter(1.0, {"offset": 1.0, "slope": 1.0})
    assert parameter.determined
    assert parameter.std == pytest.approx(0.3 * sqrt(3 / N), rel=0.1)  # as of one slope


def test_a_parameter_on_a_bound_is_not_determined() -> None:
    spread = _spread(LINE, stuck=(True, False))
    assert not spread.parameter(1.0, {"offset": 1.0}).determined
    assert spread.parameter(1.0, {"slope": 1.0}).determined


def test_five_percent_is_the_limit() -> None:
    spread = _spread(LINE)
    std = spread.parameter(1.0, {"offset": 1.0}).std
    assert spread.parameter(1.01 * std / DETERMINED, {"offset": 1.0}).determined
    assert not spread.parameter(0.99 * std / DETERMINED, {"offset": 1.0}).determined
    assert not spread.parameter(0.0, {"offset": 1.0}).determined
