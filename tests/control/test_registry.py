"""What every law must keep to, whatever its idea; a new one is tested here by its name alone."""

from __future__ import annotations

import json
from math import isfinite
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.control import registry
from endolock.control.loop import Controller
from endolock.hw.api import Calibration, ConfigError, Mode, State
from endolock.scripts.runs import rigs
from endolock.twin.surrogate import SurrogateRig
from endolock.twin.world.instrument import Instrument
from endolock.vision.observation import Observation, Status

CAMERA = Calibration(width=640, height=480, focal_px=262.0, centre_px=(319.5, 239.5))
NAMES = sorted(registry.LAWS)
PERIOD_S = 0.02
LATENCY_S = 0.4
SETTLED_RAD = 1e-9  # rounding of some hundred operations


def make(name: str) -> Controller:
    settings_ = registry.configure(name, known={"period_s": 2.0})
    rig = SurrogateRig("rest", transmission=rigs.plays_behind("play", Instrument(), 180.0))
    rig.clock.sleep_until(0.0)
    return registry.make(name, CAMERA, settings_, rig.truth)


def state(t: float, handles: tuple[float, float], clipped: tuple[int, int] = (0, 0)) -> State:
    return State(
        t=t,
        t_err=0.0,
        seq=round(t / PERIOD_S),
        position=handles,
        velocity=(0.0, 0.0),
        current=(0.0, 0.0),
        goal=handles,
        clipped=clipped,
        fresh=True,
        mode=Mode.ENABLED,
        device_tick=round(1000 * t),
    )


def seen(t: float, right: float, down: float, age_s: float = LATENCY_S) -> Observation:
    u, v = CAMERA.centre_px
    return Observation(
        t_capture=t - age_s,
        seq=round(25 * t),
        status=Status.TRACKING,
        target_px=(u + right, v + down),
        distance_m=0.12,
    )


def unseen(t: float, status: Status) -> Observation:
    return Observation(t_capture=t - LATENCY_S, seq=round(25 * t), status=status, why="hidden")


LEARNING = ("predictive", "predictive_bank")
"""Laws whose memory holds more than plain values."""
FRAMES = st.one_of(
    st.none(),
    st.tuples(
        st.floats(-400, 400), st.floats(-300, 300), st.sampled_from([0.0, 0.06, LATENCY_S, 3.0])
    ),  # also outside the picture, and older than any memory
    st.sampled_from([Status.LOST, Status.COASTING, Status.SEARCHING]),
)


def observation(t: float, frame: Any) -> Observation | None:
    if isinstance(frame, Status):
        return unseen(t, frame)
    return None if frame is None else seen(t, *frame)


def drive(law: Controller, frames: list[Any], start: int = 0) -> list[tuple[float, ...]]:
    """Give frames to a controller whose handles follow at once."""
    handles, out = (0.1, -0.2), []
    for n, frame in enumerate(frames, start):
        t = n * PERIOD_S
        command = law.update(t, state(t, handles), observation(t, frame))
        out.append(tuple(float(p) for p in command.position))
        handles = tuple(min(max(p, -3.0), 3.0) for p in out[-1])  # type: ignore[assignment]
    return out


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=15)
@given(frames=st.lists(FRAMES, min_size=1, max_size=40))
def test_commands_are_two_finite_angles_for_any_frames(name: str, frames: list[Any]) -> None:
    law = make(name)
    law.reset(state(0.0, (0.1, -0.2)))
    for position in drive(law, frames):
        assert len(position) == 2
        assert all(isfinite(angle) for angle in position)


@pytest.mark.parametrize("name", [name for name in NAMES if name not in LEARNING])
@settings(max_examples=10)
@given(first=st.lists(FRAMES, min_size=3, max_size=25), then=st.lists(FRAMES, min_size=3))
def test_a_controller_continues_from_its_saved_memory(
    name: str, first: list[Any], then: list[Any]
) -> None:
    law, other = make(name), make(name)
    law.reset(state(0.0, (0.1, -0.2)))
    drive(law, first)
    registry.restore(other, json.loads(json.dumps(registry.save(law))))
    start = len(first)
    assert drive(other, then, start) == drive(law, then, start)


@pytest.mark.parametrize("name", LEARNING)
def test_a_memory_of_more_than_plain_values_is_not_saved(name: str) -> None:
    law = make(name)
    law.reset(state(0.0, (0.1, -0.2)))
    drive(law, [(100.0, -50.0, LATENCY_S)] * 20)
    with pytest.raises(ConfigError, match="the memory of Predictive cannot be saved"):
        registry.save(law)


@pytest.mark.parametrize("name", NAMES)
def test_two_instances_share_no_state(name: str) -> None:
    one, other, third = make(name), make(name), make(name)
    for law in (one, other, third):
        law.reset(state(0.0, (0.1, -0.2)))
    frames = [(100.0, -50.0, LATENCY_S), None] * 60
    drive(one, [(-70.0, 90.0, LATENCY_S)] * 40)
    assert drive(other, frames) == drive(third, frames)


@pytest.mark.parametrize("name", [name for name in NAMES if name != "oracle"])
def test_after_a_reset_it_holds_the_handles_until_a_target_is_seen(name: str) -> None:
    law = make(name)
    drive(law, [(100.0, -50.0, LATENCY_S)] * 40)
    law.reset(state(1.0, (0.3, -0.4)))
    for n in range(5):
        t = 1.0 + n * PERIOD_S
        command = law.update(t, state(t, (0.3, -0.4)), None)
        assert command.position == pytest.approx((0.3, -0.4), abs=SETTLED_RAD)


@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("oracle", "still")])
def test_the_view_turns_towards_the_target(name: str) -> None:
    law = make(name)
    law.reset(state(0.0, (0.0, 0.0)))
    # Up and right of the centre for a second: both handles turn positive.
    frames = [(80.0, -60.0, LATENCY_S) if n % 2 == 0 else None for n in range(50)]
    handles = (0.0, 0.0)
    for n, frame in enumerate(frames):
        t = n * PERIOD_S
        position = law.update(t, state(t, handles), observation(t, frame)).position
    if name == "repetitive":  # has learned it for where it was seen, and plays it there
        position = law.update(2.5, state(2.5, handles), None).position
    assert min(position) > 0


@pytest.mark.parametrize("name", ["pi", "pi_hc", "pi_simc", "pi_simc_hc", "smith"])
def test_a_clipped_axis_integrates_only_away_from_its_limit(name: str) -> None:
    free, clipped = make(name), make(name)
    for law in (free, clipped):
        law.reset(state(0.0, (0.0, 0.0)))
    for n in range(50):
        t = n * PERIOD_S
        frame = seen(t, 80.0, 0.0) if n % 2 == 0 else None
        far = free.update(t, state(t, (0.0, 0.0)), frame).position[1]
        near = clipped.update(t, state(t, (0.0, 0.0), clipped=(0, 1)), frame).position[1]
    assert near < far
    back = [
        clipped.update(t, state(t, (0.0, 0.0), clipped=(0, 1)), seen(t, -80.0, 0.0)).position[1]
        for t in (1.0 + n * PERIOD_S for n in range(50))
    ]
    assert back[-1] < back[0]


def test_still_holds_the_handles() -> None:
    law = make("still")
    law.reset(state(0.0, (0.1, -0.2)))
    assert set(drive(law, [(100.0, -50.0, LATENCY_S), None, Status.LOST] * 10)) == {(0.1, -0.2)}


@pytest.mark.parametrize("name", ["pi", "pi_simc", "ik", "smith"])
def test_a_lost_target_stops_the_handles(name: str) -> None:
    law = make(name)
    law.reset(state(0.0, (0.0, 0.0)))
    drive(law, [(100.0, -50.0, LATENCY_S)] * 20)
    course = [
        law.update(t, state(t, (0.0, 0.0)), unseen(t, Status.LOST)).position
        for t in (0.4 + n * PERIOD_S for n in range(30))
    ]
    assert course[-1] == pytest.approx(course[-2], abs=SETTLED_RAD)


def test_the_oracle_is_refused_on_a_bench() -> None:
    with pytest.raises(
        ConfigError, match="the oracle needs the truth, which only a simulated rig has"
    ):
        registry.make("oracle", CAMERA)


@pytest.mark.parametrize(
    ("name", "changes", "why"),
    [
        ("pi", {"kd": 1.0}, "pi has no law.kd; it has ki, kp"),
        ("still", {"kp": 1.0}, "still has no law.kp; it has no settings"),
        ("pi", {"kp": -1.0}, "pi: law.kp: got -1 rad/rad, wanted 0 to 100 rad/rad; give a number"),
        ("pi", {"kp": True}, "pi: law.kp: should be a valid number, got true"),
        ("predictive", {"capstan": 1}, "law.capstan: should be a valid boolean, got 1"),
        ("predictive", {"densities": []}, "0 densities, wanted 1 to 16"),
        ("predictive", {"densities": [0.1, "x"]}, "law.densities.1: should be a valid number"),
        ("repetitive", {"period_s": 1, "points": 96.0}, "law.points: should be a valid integer"),
        ("oracle", {"plays": 3}, "law.plays: .* got 3"),
        ("oracle", {"plays": {"radii": [-1], "weights": [1]}}, "plays.radii.0: got -1 rad, wanted"),
        ("oracle", {"plays": {"radii": [1], "weights": []}}, "give the same number of each"),
        ("pi", {"kp": "much"}, "pi: law.kp: .* got 'much'"),
        ("pi_hc", {"form": "round"}, "pi_hc: law.form"),
        ("pi_hc", {"width": -0.1}, "pi_hc: law.width: got -0.1, wanted 0 to 4"),
        ("repetitive", {}, "repetitive needs law.period_s; give it with --vary law.period_s"),
        (
            "smith",
            {"closed_loop_s": 0.0},
            "smith: law.closed_loop_s: got 0 s, wanted 0.001 to 1000 s",
        ),
    ],
)
def test_settings_out_of_range_are_refused(name: str, changes: dict[str, Any], why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        registry.configure(name, changes)
