"""The search for a lost target: where it looks, how fast, and where it ends."""

from __future__ import annotations

from math import atan2, hypot, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.control.predictive import target_search
from endolock.control.transmission.kinematics import LARGEST_BEND_RAD, Pair
from endolock.hw.api import PERIOD_S, Calibration

CAMERA = Calibration(width=640, height=480, focal_px=262.0, centre_px=(319.5, 239.5))
bends = st.tuples(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2))
directions = st.tuples(st.floats(-1, 1), st.floats(-1, 1))
views = st.floats(0.2, 1.2)


def _path(last: Pair, heading: Pair, view: float) -> np.ndarray:
    times = np.arange(0.0, target_search.duration_s(view) + 1.0, PERIOD_S)
    return np.array([target_search.place(last, last, heading, t, view) for t in times.tolist()])


def test_half_the_field_of_view_is_that_of_the_nearer_edges() -> None:
    # of a pinhole: the upper edge is 239.5 px above the centre
    assert target_search.half_view_rad(CAMERA) == pytest.approx(atan2(239.5, 262.0), abs=1e-9)


@given(bends, directions, views)
def test_it_waits_then_winds_out_and_in_at_constant_speed(
    last: Pair, heading: Pair, view: float
) -> None:
    path = _path(last, heading, view)
    waiting = round(target_search.WAIT_S / PERIOD_S)
    assert path[: waiting + 1] == pytest.approx(np.tile(last, (waiting + 1, 1)), abs=1e-12)
    speed = np.hypot(*np.diff(path, axis=0).T) / PERIOD_S
    assert speed.max() <= target_search.SPEED_RAD_S * (1 + 1e-9)
    # a chord is shorter than its arc where the spiral is narrow: not at its outer half
    far = np.hypot(*(path - last).T)[:-1] > target_search.VIEW_SHARE * view / 2
    turning = np.abs(np.diff(far.astype(int), prepend=0)) > 0
    slow = speed[far & ~turning] < 0.97 * target_search.SPEED_RAD_S
    assert slow.sum() <= 2  # the tick in which outwards becomes inwards, and the next


@given(bends, directions, views)
def test_the_last_place_stays_in_the_picture_and_the_search_ends_there(
    last: Pair, heading: Pair, view: float
) -> None:
    path = _path(last, heading, view)
    away = np.hypot(*(path - last).T)
    assert away.max() <= target_search.VIEW_SHARE * view + 1e-9
    assert away.max() > 0.9 * target_search.VIEW_SHARE * view  # ticks miss the outermost point
    assert away[-40:] == pytest.approx(0.0, abs=1e-12)  # the last second lies after its end
    later = target_search.place(last, last, heading, 1e4, view)
    assert later == pytest.approx(last, abs=1e-12)


@given(bends, bends, directions, views)
def test_it_is_repeated_where_the_target_usually_was(
    last: Pair, usual: Pair, heading: Pair, view: float
) -> None:
    half = target_search.duration_s(view) / 2
    times = np.arange(0.01, half, PERIOD_S)
    around_last = [target_search.place(last, usual, heading, t, view) for t in times.tolist()]
    again = [target_search.place(last, usual, heading, half + t, view) for t in times.tolist()]
    shift = np.subtract(usual, last)
    assert np.array(again) == pytest.approx(np.array(around_last) + shift, abs=1e-9)
    assert target_search.place(last, usual, heading, 1e4, view) == pytest.approx(usual, abs=1e-12)


@given(st.floats(0, 2 * pi), views)
def test_it_begins_where_the_target_went(angle: float, view: float) -> None:
    heading = float(np.cos(angle)), float(np.sin(angle))
    first = target_search.place((0.0, 0.0), (1.0, 1.0), heading, target_search.WAIT_S + 0.02, view)
    # 6 mrad along the spiral its direction has turned by at most 6 mrad / (R/2 pi), R >= 0.07 rad
    assert np.dot(first, heading) > 0.8 * hypot(*first) > 0  # cos 0.54 = 0.86


@given(st.floats(0, 2 * pi), views)
def test_it_never_asks_for_more_than_the_section_can_bend(angle: float, view: float) -> None:
    last = 2.5 * float(np.cos(angle)), 2.5 * float(np.sin(angle))
    path = _path(last, last, view)
    assert np.hypot(*path.T).max() <= LARGEST_BEND_RAD + 1e-9
