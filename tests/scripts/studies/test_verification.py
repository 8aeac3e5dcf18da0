"""Every figure of the model card is finite and within its bounds."""

from math import isfinite

import pytest

from endolock.scripts.checks import behaviour_checks
from endolock.scripts.checks.check import Check
from endolock.scripts.studies.verification import CHECKS
from endolock.twin.world import instrument_files

FEWER = ["pretensioned", "slack"]
"""One instrument with wires under tension at rest, one with slack wires."""
NAMED = {check.measure.__name__: check for check in CHECKS}
OF_ALL = ["drift", "restored_state", "slow_loops", "work_absorbed", "work_dissipated"]
"""Checks over every instrument: the suite measures those of `FEWER`, the long tests all."""


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.measure.__name__)
def test_the_twin_agrees(check: Check, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(instrument_files, "names", lambda: FEWER)
    _within(check)


@pytest.fixture(scope="module")
def _every_instrument() -> None:
    behaviour_checks.cycle_work.cache_clear()  # which may be that of `FEWER`


@pytest.mark.slow
@pytest.mark.usefixtures("_every_instrument")
@pytest.mark.parametrize("name", OF_ALL)
def test_every_instrument_agrees(name: str) -> None:
    _within(NAMED[name])


def _within(check: Check) -> None:
    figure = check.measure()
    assert isfinite(figure)
    assert check.low <= figure <= check.high, check.why
