"""Turns of the camera as changes of the bend, and the frames between which they are."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.control.predictive.seen_frames import (
    SeenFrame,
    TipSeen,
    bend_change,
    frame_before,
    right_jacobian,
    tip_of,
)
from endolock.control.transmission import kinematics
from endolock.control.transmission.kinematics import SectionGeometry
from endolock.hw.api import Vector

BENDS = st.tuples(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2))


def _turn(before: Vector, after: Vector) -> Vector:
    """Rotation of the camera between two bends, in its axes before, by the kinematics."""
    first, second = (
        np.array(kinematics.forward(SectionGeometry(), (float(b[0]), float(b[1])))[1])
        for b in (before, after)
    )
    change = first.T @ second
    skew = (change - change.T) / 2  # sin of the angle times the axis, for small angles
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0]])


@given(BENDS, BENDS)
def test_the_turn_of_the_camera_gives_the_change_of_the_bend(
    bend: tuple[float, float], direction: tuple[float, float]
) -> None:
    before, step = np.array(bend), 1e-4 * np.array(direction)
    found = bend_change(_turn(before, before + step), before)
    assert found == pytest.approx(step, abs=1e-7)  # of second order in the step


@given(BENDS)
def test_the_jacobian_is_continuous_at_no_bend_and_keeps_the_axis(
    bend: tuple[float, float],
) -> None:
    jacobian = right_jacobian(np.array(bend))
    along = np.array([*bend, 0.0])
    assert jacobian @ along == pytest.approx(along)  # a turn about the axis of the bend itself
    tiny = right_jacobian(9e-5 * np.array(bend))
    assert tiny == pytest.approx(right_jacobian(1.1e-4 * np.array(bend)), abs=1e-4)


def test_a_bend_beyond_the_largest_is_no_error() -> None:
    assert np.isfinite(right_jacobian(np.array([3 * pi, -2 * pi]))).all()


def test_frames_are_found_by_their_times() -> None:
    zero = np.zeros(2)
    frames = [SeenFrame(0.04 * n, zero, zero, zero, False) for n in range(20)]
    tips = [TipSeen(0.04 * n, zero, zero, zero, False) for n in range(20)]
    assert tip_of(tips, 0.04 * 18) is tips[18]
    assert tip_of(tips, 0.04 * 18 + 0.01) is None
    assert frame_before(frames, 0.05) is frames[1]
    assert frame_before(frames, -0.1) is None
