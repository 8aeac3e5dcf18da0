"""The twin as a rig: one schedule, late frames, true and estimated time, reproducible bits."""

import hashlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.hw.api import Command, ConfigError, Rig
from endolock.twin.randomness import generator
from endolock.twin.rig import TwinRig
from endolock.twin.world import scenario


def _fast(**camera: float) -> scenario.Scenario:
    return scenario.load("circle", {f"camera.{key}": value for key, value in camera.items()})


def test_it_is_a_rig() -> None:
    rig: Rig = TwinRig("rest", pictures=False)  # the type checker compares it with the protocol
    assert rig.clock.now() == 0.0
    assert not rig.clock.realtime
    assert rig.tracker is None


def test_time_moves_only_while_sleeping() -> None:
    rig = TwinRig("circle", pictures=False)
    with rig:
        rig.actuators.enable()
        before = rig.plant.data.qpos.copy()
        for _ in range(5):
            rig.actuators.exchange(Command(position=(0.3, 0.3)))
            rig.camera.latest()
            rig.truth.now()
        assert rig.clock.now() == 0.0
        assert np.array_equal(rig.plant.data.qpos, before)
        assert rig.clock.sleep_until(0.0031) == pytest.approx(0.004)  # the next point of 2 ms
        assert rig.clock.sleep_until(0.001) == pytest.approx(0.004)  # it does not go back


@settings(max_examples=10)
@given(cuts=st.lists(st.integers(0, 250), max_size=12))
def test_slicing_a_sleep_changes_no_bit(cuts: list[int]) -> None:
    """Cuts are on the 2 ms grid of the physics, most of them not on the 10 ms grid of friction."""

    def end(moments: list[float]) -> tuple[bytes, int, float]:
        rig = TwinRig(_fast(latency_s=0.06, jitter_s=0.05, drop_fraction=0.2), pictures=False)
        with rig:
            rig.actuators.enable()
            rig.clock.sleep_until(0.1)  # the guard limits the goal to the speed of the handle
            rig.actuators.exchange(Command(position=(0.3, -0.3), valid_for=9.0))
            for t in [*sorted(moments), 0.6]:
                rig.clock.sleep_until(t)
            frame = rig.camera.latest()
            state = rig.plant.data
            bits = state.qpos.tobytes() + state.qvel.tobytes() + state.act.tobytes()
            bits += rig.plant.model.dof_frictionloss.tobytes()
        assert frame is not None
        assert np.abs(state.qpos).max() > 0.1  # it moved, by most of 0.3 rad
        return bits, frame.seq, frame.t_available

    assert end([0.1 + 0.002 * cut for cut in cuts]) == end([])


def test_exposures_keep_their_rate_on_a_grid_that_does_not_divide_it() -> None:
    rig = TwinRig(_fast(latency_s=0.0, frame_rate_hz=30.0), pictures=False)
    rig.clock.sleep_until(0.9)
    exposed = [rig.truth.at_exposure(seq).t for seq in range(27)]
    # at n/30 s, on the nearest point of the 2 ms grid
    assert exposed == pytest.approx([n / 30 for n in range(27)], abs=0.001)
    assert exposed[2] == pytest.approx(0.066)


def test_the_wall_stays_behind_the_board() -> None:
    far = scenario.load("rest", {"board.distance_m": 0.6})
    with TwinRig(far) as rig:
        rig.clock.sleep_until(0.4)
        frame = rig.camera.latest()
        assert frame is not None
        assert frame.image is not None
        # 20 mm right of the target, 9 px here, is paper: grey, where the wall is red
        paper, wall = frame.image[240, 329].astype(int), frame.image[240, 600].astype(int)
        assert np.ptp(paper) < 40 < np.ptp(wall)


def test_a_closed_rig_takes_no_pictures() -> None:
    rig = TwinRig("rest")
    rig.clock.sleep_until(0.1)
    rig.close()
    rig.close()
    with pytest.raises(ConfigError, match="this rig is closed; make a new one"):
        rig.clock.sleep_until(0.2)


def test_pictures_belong_to_one_thread() -> None:
    with TwinRig("rest") as rig:
        rig.clock.sleep_until(0.1)
        with ThreadPoolExecutor(1) as other:
            outcome = other.submit(rig.clock.sleep_until, 0.2).exception()
    assert isinstance(outcome, ConfigError)
    assert "in one thread only" in str(outcome)


def test_home_moves_the_limits_with_the_zero() -> None:
    rig = TwinRig("rest", pictures=False)
    with rig:
        rig.actuators.enable()
        for n in range(100):
            rig.clock.sleep_until(0.02 * n)
            rig.actuators.exchange(Command(position=(1.0, 0.0)))
        rig.actuators.disable()
        turned = rig.actuators.exchange(None).position[0]
        rig.actuators.home()
        (low, high), _ = rig.actuators.limits.position_rad
        reach = rig.plant.instrument.handle_range_rad
        assert (low, high) == pytest.approx((-reach - turned, reach - turned))


def test_an_unstable_simulation_is_an_error(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    rig = TwinRig("rest", pictures=False)
    rig.plant.data.qvel[:] = float("nan")
    with pytest.raises(ConfigError, match=r"the simulation diverged before t = 0\.010 s: MuJoCo"):
        rig.clock.sleep_until(0.01)
    assert list(tmp_path.iterdir()) == []  # MuJoCo writes no log


def test_one_seed_gives_the_same_pictures() -> None:
    def pictures() -> list[str]:
        digests = []
        with TwinRig("circle", seed=3) as rig:
            rig.actuators.enable()
            for n in range(1, 16):
                rig.actuators.exchange(Command(position=(0.02 * n, 0.01 * n)))
                rig.clock.sleep_until(0.04 * n)
                frame = rig.camera.latest()
                if frame and frame.image is not None:
                    digests.append(hashlib.sha256(frame.image.tobytes()).hexdigest())
        return digests

    first = pictures()
    assert len(set(first)) > 3  # the picture moves
    assert first == pictures()


def test_frames_arrive_late_by_the_latency_and_carry_both_times() -> None:
    rig = TwinRig(_fast(latency_s=0.1), pictures=False)
    rig.clock.sleep_until(0.098)
    assert rig.camera.latest() is None
    rig.clock.sleep_until(0.3)
    frame = rig.camera.latest()
    assert frame is not None
    assert frame.seq == 5  # exposed at 0.2 s, the sixth of 25 a second
    assert frame.t_available == pytest.approx(0.3)
    assert frame.t_capture == pytest.approx(0.2)
    assert rig.truth.at_exposure(5).t == pytest.approx(0.2)


def test_jitter_makes_capture_times_inexact_and_keeps_the_order() -> None:
    rig = TwinRig(_fast(latency_s=0.1, jitter_s=0.05), pictures=False)
    apart, last = [], -1.0
    for n in range(1, 400):
        now = rig.clock.sleep_until(0.01 * n)
        frame = rig.camera.latest()
        if frame is None:
            continue
        assert last <= frame.t_available <= now + 1e-9  # the clock's grid, nothing from the future
        last = frame.t_available
        apart.append(frame.t_capture - rig.truth.at_exposure(frame.seq).t)
    assert max(np.abs(apart)) <= 0.05 + 1e-9  # the given jitter
    assert np.std(apart) > 0.01  # uniform over +-50 ms it is 29 ms


def test_dropped_frames_are_counted_and_leave_gaps() -> None:
    rig = TwinRig(_fast(latency_s=0.0, drop_fraction=0.3), pictures=False)
    numbers, dropped = [], 0
    for n in range(1, 101):
        rig.clock.sleep_until(0.04 * n)
        frame = rig.camera.latest()
        assert frame is not None
        if frame.seq not in numbers:
            numbers.append(frame.seq)
            dropped += frame.dropped
    assert len(numbers) + dropped == numbers[-1] + 1
    assert 15 < dropped < 45  # 30 of 100; binomial with a standard deviation of 4.6


def test_noise_sources_are_independent() -> None:
    a, b = generator(1, "camera.jitter"), generator(1, "camera.drops")
    assert not np.array_equal(a.random(8), b.random(8))

    def delays(drop_fraction: float) -> dict[int, float]:
        # 10 ms of jitter cannot reorder frames 40 ms apart, so nothing else changes the time stamps
        camera = _fast(latency_s=0.1, jitter_s=0.01, drop_fraction=drop_fraction)
        rig = TwinRig(camera, pictures=False, seed=5)
        stamps = {}
        for n in range(1, 200):
            rig.clock.sleep_until(0.01 * n)
            if frame := rig.camera.latest():
                stamps[frame.seq] = frame.t_available
        return stamps

    whole, thinned = delays(0.0), delays(0.4)
    assert len(thinned) < len(whole)
    assert all(whole[seq] == stamp for seq, stamp in thinned.items())


def test_truth_is_kept_until_its_frame_is_delivered() -> None:
    rig = TwinRig(_fast(latency_s=0.4), pictures=False)
    rig.clock.sleep_until(3.0)
    frame = rig.camera.latest()
    assert frame is not None
    assert rig.truth.at_exposure(frame.seq).t == pytest.approx(frame.t_capture)
    with pytest.raises(LookupError, match=r"no truth for frame 0; known frames: \d+\.\.75"):
        rig.truth.at_exposure(0)


def test_the_handle_is_read_through_its_encoder() -> None:
    rig = TwinRig("rest", pictures=False)
    with rig:
        rig.actuators.enable()
        for n in range(1, 51):
            state = rig.actuators.exchange(Command(position=(0.3, -0.2)))
            rig.clock.sleep_until(0.02 * n)
    step = rig.plant.instrument.encoder_step_rad
    counts = np.array(state.position + state.goal) / step
    assert counts == pytest.approx(np.round(counts), abs=1e-9)  # whole counts; float division
    # the servo has no integral part and droops by 7-8 mrad under the wires' load
    assert state.position == pytest.approx((0.3, -0.2), abs=0.012)


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(ConfigError, match="seed -1; use a whole number, 0 or more"):
        TwinRig("rest", seed=-1, pictures=False)


def test_without_torque_a_geared_handle_brakes() -> None:
    rig = TwinRig("rest", pictures=False)
    with rig:
        rig.actuators.enable()
        for n in range(50):
            rig.clock.sleep_until(0.02 * n)
            turned = rig.actuators.exchange(Command(position=(0.5, 0.0))).position[0]
        rig.actuators.disable()
        fastest = 0.0
        for n in range(50, 100):
            rig.clock.sleep_until(0.02 * n)
            state = rig.actuators.exchange(None)
            fastest = max(fastest, abs(state.velocity[0]))
        assert 0 < state.position[0] < turned  # the wires pull it back without overshoot
        assert fastest < rig.actuators.limits.velocity_rad_s[0]
