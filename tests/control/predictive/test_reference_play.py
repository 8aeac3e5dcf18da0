"""Which motions of the target the handle follows: noise is not, what is worth the price is."""

from __future__ import annotations

from collections.abc import Callable
from math import pi, sin

import numpy as np
import pytest

from endolock.control.predictive import reference_play
from endolock.control.predictive.reference_play import REACHES_RAD, ReferencePlay
from endolock.hw.api import Vector

DT, FRAME_S = 0.02, 0.04
LEAD_S = 0.1
PX_PER_RAD = 470.0
"""Pixels per bend at the default distance, 0.12 m."""
SLOPE, WIDTH = 1.0, 0.6
"""Bend per handle angle, and width of the loop at the handle: those of the default endoscope."""


def _run(
    course: Callable[[float], float],
    seconds: float = 40.0,
    *,
    noise_px: float = 0.3,
    width: float = WIDTH,
    play: ReferencePlay | None = None,
) -> tuple[Vector, Vector, ReferencePlay]:
    """Follow a course that is predicted exactly but for noise; return targets and places."""
    random = np.random.default_rng(0)
    play = play or ReferencePlay(course(0.0))
    targets, places, noise = [], [], 0.0
    for n in range(int(seconds / DT)):
        t = n * DT
        if n % 2 == 0:
            noise = noise_px / PX_PER_RAD * float(random.standard_normal())
            play.judge(t, course(t) + noise, None, PX_PER_RAD)
        aim = course(t + LEAD_S) + noise
        later = np.mean([course(t + LEAD_S + part * 0.1) for part in range(4)]) + noise
        play.follow(t + LEAD_S, aim, float(later), dt=DT, slope=SLOPE, width=width)
        targets.append(course(t + LEAD_S))
        places.append(play.place)
    return np.array(targets), np.array(places), play


def _turns(places: Vector) -> int:
    steps = np.sign(np.diff(places))
    steps = steps[steps != 0]
    return int(np.sum(steps[1:] != steps[:-1]))


def _swing(px: float, period_s: float) -> Callable[[float], float]:
    return lambda t: px / PX_PER_RAD * sin(2 * pi * t / period_s)


@pytest.mark.parametrize("noise_px", [0.3, 1.0, 2.0, 3.0])
def test_noise_does_not_turn_it(noise_px: float) -> None:
    _, places, _ = _run(lambda _t: 0.2, noise_px=noise_px)
    half = len(places) // 2  # it has been chosen by then
    assert _turns(places[half:]) <= 1
    # a play that only drifts with the mean moves the bend by less than the noise
    assert np.ptp(places[half:]) < max(noise_px, 1.0) / PX_PER_RAD


def test_breathing_is_followed_and_a_heartbeat_is_not() -> None:
    """10 mm in 4 s and 1.5 mm in 0.9 s at a distance of 12 cm, through a loop of 0.6 rad."""
    targets, places, _ = _run(_swing(0.01 / 2 / 0.12 * PX_PER_RAD, 4.0))
    late = slice(len(places) // 2, None)
    assert np.std(places[late] - targets[late]) < 0.3 * np.std(targets[late])
    _, places, _ = _run(_swing(0.0015 / 2 / 0.12 * PX_PER_RAD, 0.9))
    assert np.ptp(places[late]) < 0.0015 / 2 / 0.12 / 2  # a play of this size, or the slow mean


def test_motion_is_followed_where_its_gain_is_worth_its_travel() -> None:
    """The stated price: ln of the ratio of squared errors against travel per `PRICE_RAD_S`."""
    period, px = 4.0, 10.0
    travel = [2 / period * (2 * px / PX_PER_RAD / SLOPE + width) for width in (0.1, 10.0)]
    gain = np.log(px**2 / 2 + 1)  # from the error of never moving to none at all
    assert travel[0] / reference_play.PRICE_RAD_S < gain < travel[1] / reference_play.PRICE_RAD_S
    moved = [np.ptp(_run(_swing(px, period), width=width)[1][1000:]) for width in (0.1, 10.0)]
    assert moved[0] > px / PX_PER_RAD  # half of the swing
    assert moved[1] < 0.5 * px / PX_PER_RAD


def test_a_long_way_is_followed_closely_and_a_short_preview_changes_nothing() -> None:
    targets, places, play = _run(_swing(100.0, 8.6))
    assert np.std(places[1000:] - targets[1000:]) * PX_PER_RAD < 4.0  # of 71
    before = play.place, play.direction
    ahead = play.ahead([play.place + 0.2, play.place + 0.3])
    assert ahead > play.place
    assert (play.place, play.direction) == before


def test_a_change_of_the_model_moves_all_outputs_and_no_merits() -> None:
    """A step of the model's bend moves targets and outputs alike, so the choice stays as it was."""
    course = _swing(60.0, 6.0)
    _, plain, _ = _run(course, 60.0)
    *_, play = _run(course, 30.0)
    by = 0.1
    place, reach = play.place, play.reach_rad
    play.move(by)
    assert play.place == pytest.approx(place + by)
    moved = []
    for n in range(int(30.0 / DT), int(36.0 / DT)):
        t = n * DT
        if n % 2 == 0:
            play.judge(t, course(t) + by, None, PX_PER_RAD)
        aim = course(t + LEAD_S) + by
        later = float(np.mean([course(t + LEAD_S + part * 0.1) for part in range(4)])) + by
        play.follow(t + LEAD_S, aim, later, dt=DT, slope=SLOPE, width=WIDTH)
        moved.append(play.place - by)
    assert play.reach_rad == reach
    # apart from the noise of the run to compare with
    assert moved == pytest.approx(plain[1500:1800].tolist(), abs=0.02)


def test_after_a_gap_it_starts_where_it_is_told_and_keeps_its_choice() -> None:
    *_, play = _run(_swing(60.0, 6.0))
    reach = play.reach_rad
    play.restart(-0.3)
    assert (play.place, play.direction, play.reach_rad) == (-0.3, 0.0, reach)
    play.judge(41.0, 0.5, None, PX_PER_RAD)  # nothing was said for that time
    assert play.reach_rad == reach


def test_offsets_that_motion_makes_worse_are_charged_to_it() -> None:
    """Without a background: the model promises a small error, and the target is seen far off."""
    course = _swing(8.0, 4.0)
    chosen = []
    for off in (0.0, 60.0 / PX_PER_RAD):
        play = ReferencePlay(0.0)
        for n in range(int(40.0 / DT)):
            t = n * DT
            if n % 2 == 0:
                play.judge(t, course(t), off, PX_PER_RAD)
            aim = course(t + LEAD_S)
            play.follow(t + LEAD_S, aim, aim, dt=DT, slope=SLOPE, width=0.3)
        chosen.append(play.reach_rad)
    assert chosen[0] < chosen[1] == REACHES_RAD[-1]


@pytest.mark.parametrize(("known", "moves"), [(True, True), (False, False)])
def test_while_the_transmission_is_not_known_motion_must_be_worth_it_by_far(
    known: bool, moves: bool
) -> None:
    """Motion that saves a third of the squared error, at no cost of travel to speak of."""
    period, play = 20.0, ReferencePlay(0.0)
    target = _swing(20.0, period)
    random = np.random.default_rng(0)
    for n in range(int(60.0 / DT)):
        t = n * DT
        if n % 2 == 0:
            seen = target(t) + 20.0 / PX_PER_RAD * float(random.standard_normal())
            play.judge(t, seen, None, PX_PER_RAD, known=known)
        aim = target(t + LEAD_S)
        play.follow(t + LEAD_S, aim, aim, dt=DT, slope=SLOPE, width=0.0)
    assert bool(play.reach_rad < REACHES_RAD[-1]) is moves


def test_a_mirrored_course_gives_mirrored_places() -> None:
    course = _swing(60.0, 6.0)
    _, places, play = _run(course, 20.0)
    _, mirrored, other = _run(lambda t: -course(t), 20.0, noise_px=-0.3)
    assert mirrored == pytest.approx(-places, abs=1e-12)
    assert other.reach_rad == play.reach_rad
