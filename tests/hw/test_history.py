"""The memory of handle states."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.hw.api import Mode, State
from endolock.hw.history import KEPT_S, AngleHistory, History

RATE = (0.7, -1.3)
START = (-0.2, 0.4)

times = st.lists(st.integers(0, 9_000), min_size=2, max_size=30, unique=True).map(
    lambda ms: [t / 1000 for t in sorted(ms)]
)


def state(t: float, position: tuple[float, ...], seq: int = 0) -> State:
    return State(
        t=t,
        t_err=0.0,
        seq=seq,
        position=position,
        velocity=tuple(2 * p for p in position),  # anything that is not constant
        current=(0.1, 0.2),
        goal=position,
        clipped=(0, 0),
        fresh=True,
        mode=Mode.ENABLED,
        device_tick=round(t * 1000),
    )


def line(t: float) -> tuple[float, float]:
    """Uniform motion."""
    return START[0] + RATE[0] * t, START[1] + RATE[1] * t


def remember(at: list[float], span_s: float = 10.0) -> tuple[History, list[State]]:
    """Make a history of uniform motion."""
    history = History(span_s)
    states = [state(t, line(t), seq) for seq, t in enumerate(at)]
    for s in states:
        history.append(s)
    return history, states


@settings(deadline=None)
@given(times, st.floats(0, 1))
def test_between_states_it_is_linear(at: list[float], share: float) -> None:
    history, states = remember(at)
    t = at[0] + share * (at[-1] - at[0])
    got = history.at(min(t, at[-1]))
    assert got.t == min(t, at[-1])
    assert got.position == pytest.approx(line(t), abs=1e-12)  # rounding of a few operations
    assert got.velocity == pytest.approx([2 * p for p in line(t)], abs=1e-12)  # the same
    assert got.seq == max(s.seq for s in states if s.t <= got.t)  # all else from the one before


@settings(deadline=None)
@given(times)
def test_it_is_exact_where_a_state_was_measured(at: list[float]) -> None:
    history, states = remember(at)
    assert [history.at(t) for t in at] == states


def test_position_and_velocity_are_weighted_by_nearness() -> None:
    history = History()
    history.append(state(1.0, (0.0, 10.0)))
    history.append(state(2.0, (4.0, 20.0)))
    assert history.at(1.25).position == (1.0, 12.5)  # exact: quarters in binary


def test_outside_the_remembered_span_there_is_no_state() -> None:
    with pytest.raises(LookupError, match=r"t = 1\.000 s; remembered is nothing$"):
        History().at(1.0)
    history, _ = remember([1.0, 1.5])
    for t in (0.999, 1.501, float("nan")):
        with pytest.raises(LookupError, match=r"^no handle state at .*remembered is 1\.000\.\.1\."):
            history.at(t)


@settings(deadline=None)
@given(st.lists(st.floats(0.001, 3.0), min_size=1, max_size=200), st.sampled_from([0.5, 2.0, 10.0]))
def test_trimming_keeps_the_span(steps: list[float], span_s: float) -> None:
    history = History(span_s)
    t = 0.0
    for step in steps:
        t += step
        history.append(state(t, line(t)))
        back = max(t - span_s, steps[0])
        # 200 sums of floats below 600.
        assert history.at(back).position == pytest.approx(line(back), abs=1e-9)


def test_trimming_drops_old_packets() -> None:
    history, _ = remember([n * 0.1 for n in range(1000)], span_s=1.0)
    with pytest.raises(LookupError):
        history.at(90.0)  # 9.9 s before the end, more than twice the span


def test_a_state_measured_no_later_replaces_the_last() -> None:
    history = History()
    history.append(state(1.0, (0.0, 0.0), seq=0))
    history.append(state(2.0, (1.0, 1.0), seq=1))
    history.append(state(1.9, (3.0, 3.0), seq=2))  # time never runs backwards in here
    assert (history.at(2.0).seq, history.at(2.0).position) == (2, (3.0, 3.0))
    assert history.at(1.5).position == (1.5, 1.5)


@given(times, st.floats(-20.0, 20.0))
def test_plain_angles_are_those_of_the_states_and_constant_outside(
    at: list[float], t: float
) -> None:
    history, states = remember([at[-1] - 0.2 * (at[-1] - s) for s in at])  # within what is kept
    angles = AngleHistory()
    for s in states:
        angles.append(s)
        angles.append(replace(s, position=(9.0, 9.0)))  # no newer
    first, last = states[0].t, states[-1].t
    assert angles.at(t) == history.at(min(max(t, first), last)).position


def test_plain_angles_are_forgotten_after_a_while() -> None:
    angles = AngleHistory()
    for s in remember([n * 0.1 for n in range(100)])[1]:
        angles.append(s)
    assert angles.times[-1] - angles.times[0] == pytest.approx(KEPT_S, abs=0.1)
    assert len(angles.times) == len(angles.angles)
