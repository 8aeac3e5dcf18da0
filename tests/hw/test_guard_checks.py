"""Goals that arrive late still arrive; goals that stay away are a lost link."""

from __future__ import annotations

import pytest

from endolock.hw.api import AXES, PERIOD_S, LinkLost
from endolock.hw.drive import Reading
from endolock.hw.guard_checks import LAG, Checks, GuardSettings


def reading(goal: float) -> Reading:
    """Read handles that report this goal."""
    both = (0.0, 0.0)
    return Reading(
        t=0.0,
        t_err=0.0,
        position=both,
        velocity=both,
        current=both,
        fresh=True,
        device_tick=0,
        goal=(goal, goal),
    )


def test_a_motor_that_reports_the_goal_before_has_taken_goals() -> None:
    checks = Checks(AXES, GuardSettings())
    for n in range(100):
        sent = 0.01 * n
        checks.taken(reading(0.01 * max(0, n - LAG + 1)), (sent, sent), n * PERIOD_S)


def test_a_motor_that_reports_an_old_goal_has_not() -> None:
    checks = Checks(AXES, GuardSettings())
    longest = round(GuardSettings().max_age_s / PERIOD_S) + LAG

    def stay_away() -> None:
        for n in range(longest + 2):
            checks.taken(reading(0.0), (0.01 * n, 0.01 * n), n * PERIOD_S)

    with pytest.raises(LinkLost, match=r"^no goal reached up_down for 0\.\d{3} s, though it"):
        stay_away()
