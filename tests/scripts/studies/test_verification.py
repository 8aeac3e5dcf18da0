"""Every figure of the model card stays within its bounds, and is a figure."""

from math import isfinite

import pytest

from endolock.scripts.checks.strokes import Check
from endolock.scripts.studies.verification import CHECKS


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.measure.__name__)
def test_the_twin_agrees(check: Check) -> None:
    figure = check.measure()
    assert isfinite(figure)
    assert check.low <= figure <= check.high, check.why
