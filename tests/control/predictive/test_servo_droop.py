"""What a servo without integral action stops short of, learnt for both directions."""

from __future__ import annotations

from math import exp

import numpy as np
import pytest

from endolock.control.predictive.servo_droop import LARGEST_RAD, ServoDroop
from endolock.control.transmission.linear_process import LAG_S

DT = 0.02


def _followed(falling: float, rising: float) -> ServoDroop:
    """Follow slow triangles for 20 s with a servo that stops short."""
    servo, position, sent, before = ServoDroop(), 0.0, 0.0, 0.0
    for n in range(1000):
        t = n * DT
        goal = 0.5 * float(np.interp(t % 4.0, [0, 2, 4], [-1, 1, -1]))
        speed = 0.5 if t % 4.0 < 2 else -0.5
        short = rising if speed > 0 else falling
        old = position
        position = sent - short + exp(-DT / LAG_S) * (position - (sent - short))
        servo.measure(before, position, (position - old) / DT, DT)
        before, sent = goal, servo.corrected(goal)
    return servo


@pytest.mark.parametrize(("falling", "rising"), [(-0.008, 0.008), (0.0, 0.005), (0.004, 0.004)])
def test_the_droop_of_each_direction_is_learnt(falling: float, rising: float) -> None:
    servo = _followed(falling, rising)
    # it is learnt from the corrected motion, so part of a turn is seen with the wrong droop
    assert servo.droops == pytest.approx([falling, rising], abs=0.002)


def test_a_servo_that_arrives_is_not_corrected() -> None:
    servo = _followed(0.0, 0.0)
    assert servo.droops == pytest.approx([0.0, 0.0], abs=0.001)


def test_the_correction_is_bounded_and_changes_without_a_step() -> None:
    servo = _followed(-0.5, 0.5)
    assert max(abs(droop) for droop in servo.droops) <= LARGEST_RAD
    sent = [servo.corrected(goal) for goal in np.linspace(0.3, -0.3, 601).tolist()]
    assert max(abs(np.diff(sent))) < 0.001 + 2 * LARGEST_RAD / 15  # 20 ticks from one to the other


def test_a_handle_that_moves_fast_teaches_nothing() -> None:
    servo = ServoDroop()
    for n in range(100):
        servo.corrected(0.04 * n)
        servo.measure(0.04 * n, 0.04 * n - 0.3, 2.0, DT)
    assert servo.droops == [0.0, 0.0]
