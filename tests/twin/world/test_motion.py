"""Motions of the board: closed forms, smoothness, and statistics of the random one."""

from math import pi, radians, sqrt, tan
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from endolock.hw.api import Vector
from endolock.twin.randomness import generator
from endolock.twin.world import motion

PERIOD_S = 8.6
TRIANGLE = motion.Triangle(kind="triangle", travel_m=0.13, period_s=PERIOD_S)
RANDOM = motion.Random(kind="random")
RMS_PLACE_M = 0.03 / (2 * pi * 0.3)


@given(t=st.floats(0.0, 100.0), direction_deg=st.floats(-180.0, 180.0))
def test_strokes_stay_on_one_side_of_a_line(t: float, direction_deg: float) -> None:
    for made in (
        motion.Strokes(
            kind="strokes", direction_deg=direction_deg, travel_m=0.13, period_s=PERIOD_S
        ),
        TRIANGLE.model_copy(update={"direction_deg": direction_deg}),
    ):
        right, down = made.offset(t)
        far_right, far_down = made.offset(PERIOD_S / 2)
        along = (right * far_right + down * far_down) / 0.13
        assert -1e-12 <= along <= 0.13 + 1e-12  # rounding
        assert right * far_down == pytest.approx(down * far_right, abs=1e-12)  # rounding


@pytest.mark.parametrize("kind", ["strokes", "triangle"])
def test_strokes_to_the_right_and_up(kind: str) -> None:
    values = {"kind": kind, "travel_m": 0.13, "period_s": PERIOD_S}
    right = motion.KINDS[kind].model_validate(values)
    assert isinstance(right, motion.Strokes | motion.Triangle)
    assert right.offset(0.0) == (0.0, 0.0)
    assert right.offset(PERIOD_S / 2) == pytest.approx((0.13, 0.0))
    up = right.model_copy(update={"direction_deg": 90.0})
    assert up.offset(PERIOD_S / 2) == pytest.approx((0.0, -0.13))


@given(t=st.floats(0.0, 100.0))
def test_the_circle_is_a_circle(t: float) -> None:
    circle = motion.Circle(kind="circle", radius_m=0.06, period_s=20.0)
    right, down = circle.offset(t)
    assert right**2 + down**2 == pytest.approx(0.06**2)


def test_the_circle_is_clockwise_and_starts_at_the_right() -> None:
    circle = motion.Circle(kind="circle", radius_m=0.06, period_s=20.0)
    assert circle.offset(0.0) == pytest.approx((0.06, 0.0))
    assert circle.offset(5.0) == pytest.approx((0.0, 0.06))


def test_the_triangle_has_one_speed_and_one_acceleration() -> None:
    step = 1e-3
    places = np.array([TRIANGLE.offset(n * step)[0] for n in range(17200)])
    speeds = np.diff(places) / step
    times = step * (np.arange(speeds.size) + 0.5)
    speed = 2 * 0.13 / (PERIOD_S - 0.3)
    to_turn = np.abs((times + PERIOD_S / 4) % (PERIOD_S / 2) - PERIOD_S / 4)
    straight = to_turn > 0.15 + step  # half a reversal
    assert np.abs(speeds[straight]) == pytest.approx(speed)
    # At the ends of a reversal the mean over a step hides up to one step's change of speed.
    assert np.abs(np.diff(speeds)).max() <= 2 * speed / 0.3 * step * (1 + 1e-6)
    turns = to_turn < 0.15 - step
    assert np.abs(speeds[turns]) == pytest.approx(speed * to_turn[turns] / 0.15)


@given(t=st.floats(0.0, 100.0), turn_s=st.floats(0.001, PERIOD_S / 2))
def test_the_triangle_never_jumps(t: float, turn_s: float) -> None:
    triangle = motion.Triangle(kind="triangle", travel_m=0.13, period_s=PERIOD_S, turn_s=turn_s)
    speed = 2 * 0.13 / (PERIOD_S - turn_s)
    before, after = triangle.offset(t)[0], triangle.offset(t + 1e-3)[0]
    assert abs(after - before) <= speed * 1e-3 + 1e-12  # rounding


def test_a_reversal_longer_than_half_a_period_is_refused() -> None:
    with pytest.raises(ValidationError, match=r"turn_s 0\.6 is more than half of period_s 1; use"):
        motion.Triangle(kind="triangle", travel_m=0.1, period_s=1.0, turn_s=0.6)


def test_the_travel_of_a_sine_is_peak_to_peak() -> None:
    breathing = motion.Sine(kind="sine", travel_m=0.01, frequency_hz=0.25, direction_deg=90.0)
    places = [breathing.offset(t)[1] for t in (0.0, 1.0, 2.0, 3.0)]
    assert places == pytest.approx([0.0, -0.005, 0.0, 0.005])


@given(t=st.floats(0.0, 200.0))
def test_the_frequency_of_a_sine_drifts_around_its_mean(t: float) -> None:
    """By s'^2 + (2 pi f)^2 s^2 = (pi f travel)^2, of a sine whose frequency hardly changes."""
    drifting = motion.Sine(
        kind="sine", travel_m=0.1, frequency_hz=0.2, drift_share=0.3, drift_period_s=80.0
    )
    s, step = drifting.offset(t)[0], 1e-4
    speed = (drifting.offset(t + step)[0] - drifting.offset(t - step)[0]) / (2 * step)
    f = 0.2 * (1 + 0.3 * np.sin(2 * pi * t / 80.0))
    # the difference quotient is exact to 1e-9 m/s
    assert np.hypot(speed, 2 * pi * f * s) == pytest.approx(pi * f * 0.1, rel=1e-5)
    steady = drifting.model_copy(update={"drift_share": 0.0})
    assert steady.offset(t)[0] == pytest.approx(0.05 * np.sin(2 * pi * 0.2 * t), abs=1e-12)


def test_a_jump_has_constant_speed_and_is_permanent() -> None:
    jump = motion.Jump(kind="jump", travel_m=0.02, start_s=10.0, over_s=1.0, direction_deg=-90.0)
    places = [jump.offset(t)[1] for t in (0.0, 10.0, 10.25, 11.0, 1e6)]
    assert places == pytest.approx([0.0, 0.0, 0.005, 0.02, 0.02])


def test_every_kind_is_listed_under_its_name() -> None:
    union, _ = get_args(motion.BoardMotion)
    named = {get_args(kind.model_fields["kind"].annotation)[0]: kind for kind in get_args(union)}
    assert named == motion.KINDS


# The random motion -----------------------------------------------------------------------------


def _sampled(count: int, step_s: float, seed: int = 0) -> Vector:
    path = RANDOM.path(generator(seed, "board.random"))
    return np.array([path.offset(n * step_s) for n in range(count)])


def test_random_motion_has_the_given_rms_speed() -> None:
    places = _sampled(200_000, 0.01)
    speed = np.diff(places, axis=0) / 0.01
    # 2000 s hold some 2500 independent values of the speed (correlation time 0.4 s), so its rms has
    # a standard deviation of 1.4 %; the position is slower and has 2.5 %. Four standard deviations:
    assert np.sqrt(np.mean(speed**2, axis=0)) == pytest.approx([0.03, 0.03], rel=0.06)
    assert np.sqrt(np.mean(places**2, axis=0)) == pytest.approx([RMS_PLACE_M] * 2, rel=0.10)
    together = np.mean(places[:, 0] * places[:, 1]) / RMS_PLACE_M**2
    assert abs(together) < 0.12  # the axes are independent: some 1200 values, four times 3 %


def test_random_motion_has_the_spectrum_of_the_low_pass() -> None:
    """One-sided density S0 / (1 + (f/f0)^4) with S0 = rms^2 2 sqrt(2) / (pi f0)."""
    rate, count = 20.0, 1024
    window = np.hanning(count)
    pieces = _sampled(count * 100, 1 / rate).reshape(100, count, 2) * window[:, None]
    power = np.mean(np.abs(np.fft.rfft(pieces, axis=1)) ** 2, axis=(0, 2))
    density = 2 * power / (rate * np.sum(window**2))
    frequency = np.fft.rfftfreq(count, 1 / rate)
    law = RMS_PLACE_M**2 * 2 * sqrt(2) / (pi * 0.3) / (1 + (frequency / 0.3) ** 4)
    for low, high in ((0.06, 0.2), (0.2, 0.4), (0.4, 0.8), (0.8, 1.6), (1.6, 3.2)):
        band = (frequency >= low) & (frequency < high)
        # 100 pieces, 2 axes and 7 or more bins, which overlap by half: 4 % or less, four times
        assert np.mean(density[band] / law[band]) == pytest.approx(1.0, abs=0.16), (low, high)


def test_random_motion_is_stationary_from_the_start() -> None:
    starts = np.array([_sampled(2, 0.01, seed) for seed in range(500)])
    speeds = np.diff(starts, axis=1)[:, 0] / 0.01
    # 1000 values each: 2.2 %, four times
    assert np.sqrt(np.mean(starts[:, 0] ** 2)) == pytest.approx(RMS_PLACE_M, rel=0.09)
    assert np.sqrt(np.mean(speeds**2)) == pytest.approx(0.03, rel=0.09)


@settings(max_examples=30)
@given(times=st.lists(st.floats(0.0, 60.0), min_size=1, max_size=20))
def test_random_motion_depends_on_time_alone(times: list[float]) -> None:
    def path() -> motion.RandomPath:
        return RANDOM.path(generator(3, "board.random"))

    one, other = path(), path()
    asked = {t: one.offset(t) for t in times}
    assert {t: other.offset(t) for t in sorted(times, reverse=True)} == asked
    assert [path().offset(t) for t in times] == [asked[t] for t in times]


@given(n=st.integers(1, 5000))
def test_random_motion_is_smooth_across_its_grid(n: int) -> None:
    path = RANDOM.path(generator(0, "board.random"))
    t = n / (RANDOM.cutoff_hz * path.STEPS_PER_PERIOD)
    before, here, after = (np.array(path.offset(t + dt)) for dt in (-1e-6, 0.0, 1e-6))
    # Over 1 us the speed changes by 1e-6 s times an acceleration below 10 m/s2.
    assert np.abs((after - here) - (here - before)).max() < 1e-6 * 1e-6 * 10


def test_random_motion_differs_between_seeds_and_scales_with_the_speed() -> None:
    assert not np.array_equal(_sampled(3, 1.0, 0), _sampled(3, 1.0, 1))
    fast = RANDOM.model_copy(update={"speed_rms_m_s": 0.06}).path(generator(0, "board.random"))
    assert [fast.offset(float(n)) for n in range(3)] == pytest.approx(2 * _sampled(3, 1.0))


def test_the_direction_is_an_angle_in_the_picture() -> None:
    right, down = motion.along(1.0, 30.0)
    assert -down / right == pytest.approx(tan(radians(30.0)))
