"""The PI controller, and controllers by name."""

from __future__ import annotations

from math import inf, nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.control import registry
from endolock.control.laws.pi import PI, PISettings
from endolock.hw.api import Calibration, Command, ConfigError, Mode, State
from endolock.vision.observation import Observation, Status

CAMERA = Calibration(width=640, height=480, focal_px=250.0, centre_px=(319.5, 239.5))
PERIOD_S = 0.02
ROUNDING = 1e-12  # some hundred operations on numbers of order one


def state(position: tuple[float, float] = (0.0, 0.0), clipped: tuple[int, int] = (0, 0)) -> State:
    return State(
        t=0.0,
        t_err=0.0,
        seq=0,
        position=position,
        velocity=(0.0, 0.0),
        current=(0.0, 0.0),
        goal=position,
        clipped=clipped,
        fresh=True,
        mode=Mode.ENABLED,
        device_tick=0,
    )


def seen(right_px: float, down_px: float) -> Observation:
    """Observe the target at an offset from the centre [px]."""
    u, v = CAMERA.centre_px
    pixel = (u + right_px, v + down_px)
    return Observation(t_capture=0.0, seq=0, status=Status.TRACKING, target_px=pixel)


def unseen(status: Status) -> Observation:
    return Observation(t_capture=0.0, seq=0, status=status)


def law(gains: PISettings | None = None, start: tuple[float, float] = (0.0, 0.0)) -> PI:
    made = PI(CAMERA, gains)
    made.reset(state(start))
    return made


def play(
    pi: PI, observation: Observation | None, ticks: int, clipped: tuple[int, int] = (0, 0)
) -> list[Command]:
    """Give one frame, then continue without frames."""
    return [
        pi.update(n * PERIOD_S, state(clipped=clipped), observation if n == 0 else None)
        for n in range(ticks)
    ]


@pytest.mark.parametrize(
    "gains", [PISettings(kp=0.2, ki=0.0), PISettings(kp=0.0, ki=0.3)], ids=["p", "i"]
)
@pytest.mark.parametrize(
    ("right_px", "down_px", "axis", "sign"),
    [(0, -50, 0, 1), (0, 50, 0, -1), (50, 0, 1, 1), (-50, 0, 1, -1)],
    ids=["above", "below", "right", "left"],
)
def test_handles_turn_the_view_towards_the_target(
    gains: PISettings, right_px: float, down_px: float, axis: int, sign: int
) -> None:
    command = play(law(gains), seen(right_px, down_px), 10)[-1]
    assert sign * command.position[axis] > 0
    assert command.position[1 - axis] == 0.0  # the other axis has no error


@settings(deadline=None)
@given(st.floats(-320, 320), st.floats(-240, 240), st.floats(0, 2), st.floats(0, 2))
def test_a_constant_error_gives_the_closed_form(
    right_px: float, down_px: float, kp: float, ki: float
) -> None:
    start = (0.3, -0.2)
    commands = play(law(PISettings(kp=kp, ki=ki), start), seen(right_px, down_px), 50)
    error = (-down_px / CAMERA.focal_px, right_px / CAMERA.focal_px)
    for n, command in enumerate(commands):
        expected = [i + kp * e + ki * e * n * PERIOD_S for i, e in zip(start, error, strict=True)]
        assert command.position == pytest.approx(expected, abs=ROUNDING)


def test_the_integral_depends_on_time_and_not_on_the_number_of_ticks() -> None:
    even, uneven = law(PISettings(kp=0.0)), law(PISettings(kp=0.0))
    for t in (0.0, 0.02, 0.04, 0.06, 0.08, 0.10):
        one = even.update(t, state(), seen(50, 50))
    for t in (0.0, 0.06, 0.10):  # ticks were skipped
        other = uneven.update(t, state(), seen(50, 50))
    assert one.position == pytest.approx(other.position, abs=ROUNDING)


def test_reset_is_bumpless() -> None:
    pi = law()
    play(pi, seen(200, 200), 100)
    pi.reset(state((0.7, -0.4)))
    assert pi.update(50.0, state((0.7, -0.4)), None).position == (0.7, -0.4)
    pi = law(PISettings(kp=0.0))
    play(pi, None, 100)
    pi.reset(state((0.7, -0.4)))
    # The time before the reset does not count, nor does the one from then to the first tick.
    assert pi.update(50.0, state((0.7, -0.4)), seen(200, 200)).position == (0.7, -0.4)


@pytest.mark.parametrize("clipped", [1, -1])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_clipped_axis_stops_integrating_and_the_other_continues(axis: int, clipped: int) -> None:
    flags = (clipped, 0) if axis == 0 else (0, clipped)
    outward = seen(50 * clipped, -50 * clipped)  # both axes are asked for more of that sign
    pi = law(PISettings(kp=0.0, ki=1.0))
    stopped = play(pi, outward, 51, flags)[-1]
    assert stopped.position[axis] == 0.0
    free = clipped * 50 / CAMERA.focal_px  # ki e t, after 1 s
    assert stopped.position[1 - axis] == pytest.approx(free, abs=ROUNDING)


@pytest.mark.parametrize("clipped", [1, -1])
def test_a_clipped_axis_integrates_away_from_its_limit(clipped: int) -> None:
    pi = law(PISettings(kp=0.0, ki=1.0))
    inward = seen(-50 * clipped, 50 * clipped)
    back = play(pi, inward, 51, (clipped, clipped))[-1]
    expected = -clipped * 50 / CAMERA.focal_px  # ki e t, after 1 s
    assert back.position == pytest.approx((expected, expected), abs=ROUNDING)


@pytest.mark.parametrize("status", [Status.SEARCHING, Status.COASTING, Status.LOST])
def test_without_a_target_there_is_no_error(status: Status) -> None:
    pi = law(PISettings(kp=0.2, ki=1.0))
    play(pi, seen(100, 100), 51)
    integral = 1.0 * 100 / CAMERA.focal_px  # ki e t, after 1 s
    blind = pi.update(51 * PERIOD_S, state(), unseen(status))
    # The proportional part goes at once, the integral stays.
    assert blind.position == pytest.approx((-integral, integral), abs=ROUNDING)
    later = pi.update(60 * PERIOD_S, state(), None)
    assert later.position == blind.position


def test_two_controllers_share_no_state() -> None:
    alone, one, other = law(), law(), law(start=(-0.5, 0.5))
    for n in range(20):
        expected = alone.update(n * PERIOD_S, state(), seen(30, -20))
        got = one.update(n * PERIOD_S, state(), seen(30, -20))
        other.update(n * PERIOD_S * 3, state(clipped=(1, -1)), seen(-200, 150))
        assert got == expected


@pytest.mark.parametrize("gain", ["kp", "ki"])
@pytest.mark.parametrize(
    ("value", "text"),
    [
        (-0.1, "got -0.1 "),
        (1e4, "got 10000 "),
        (nan, "should be a finite number, got nan"),
        (inf, "should be a finite number, got inf"),
        ("1", "should be a valid number, got '1'"),
    ],
)
def test_bad_gains_are_refused(gain: str, value: float, text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        PISettings(**{gain: value})
    assert str(caught.value).startswith(f"pi: {gain}: {text}")


def test_a_controller_is_found_by_its_name() -> None:
    assert isinstance(registry.make("pi", CAMERA), PI)
    assert registry.make("pi", CAMERA) is not registry.make("pi", CAMERA)


def test_an_unknown_controller_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"^controller 'pid' is unknown; use .*\bpi\b.*; did you"):
        registry.make("pid", CAMERA)
