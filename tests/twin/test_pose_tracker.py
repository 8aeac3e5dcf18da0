"""The virtual pose tracker: rate, latency, noise, dropouts, and no side effects."""

from math import degrees, hypot, pi
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.hw.api import Command, Pose
from endolock.twin.rig import TwinRig
from endolock.twin.world import scenario
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.scenario import Scenario
from endolock.twin.world.scenario_sections import PoseTrackerSettings


def _rig(seed: int = 0, instrument: Instrument | None = None, **tracker: float) -> TwinRig:
    watched = scenario.load("rest").model_copy(update={"tracker": PoseTrackerSettings(**tracker)})
    return TwinRig(watched, seed=seed, instrument=instrument, pictures=False)


def _poses(rig: TwinRig, count: int, every_s: float = 0.010) -> list[Pose]:
    """Collect every pose of a rig at rest."""
    assert rig.tracker is not None
    found: dict[float, Pose] = {}
    for n in range(count):
        rig.clock.sleep_until(n * every_s)
        if pose := rig.tracker.latest():
            found[pose.t] = pose
    return list(found.values())


def test_without_noise_it_measures_the_bend() -> None:
    rig = _rig(position_noise_m=0.0, rotation_noise_deg=0.0, latency_s=0.0)
    with rig:
        rig.actuators.enable()
        for n in range(100):
            rig.actuators.exchange(Command(position=(0.01 * n, -0.005 * n)))
            rig.clock.sleep_until(0.02 * (n + 1))
        assert rig.tracker is not None
        pose, truth = rig.tracker.latest(), rig.truth.now()
    assert pose is not None
    assert pose.t == truth.t
    # the rotation about the distal axis is small, but no bend; rounding
    assert pose.rotation_vector[:2] == pytest.approx(truth.plant.bend_rad, abs=1e-12)
    assert pose.position == pytest.approx(truth.plant.tip.position, abs=1e-12)
    assert hypot(*truth.plant.bend_rad) > 0.2


def test_a_misaligned_camera_does_not_rotate_the_body() -> None:
    silent: dict[str, Any] = {"position_noise_m": 0.0, "rotation_noise_deg": 0.0}
    (pose,) = _poses(_rig(instrument=Instrument(misalignment_rad=0.3), **silent), 2)
    assert pose.quaternion == (1.0, 0.0, 0.0, 0.0)


def test_it_measures_at_its_rate_and_delivers_late() -> None:
    rig = _rig(rate_hz=50.0, latency_s=0.03)
    assert rig.tracker is not None
    arrivals: dict[float, float] = {}
    for n in range(100):
        t = rig.clock.sleep_until(0.002 * n)
        if pose := rig.tracker.latest():
            arrivals.setdefault(pose.t, t)
    assert list(arrivals) == pytest.approx(np.arange(9) * 0.02)  # 0.198 s minus 0.03 s
    late = [arrival - measured for measured, arrival in arrivals.items()]
    assert late == pytest.approx([0.03] * len(late), abs=0.002)  # polled every 2 ms


def test_the_noise_has_the_given_deviation() -> None:
    rig = _rig(position_noise_m=0.001, rotation_noise_deg=0.5, latency_s=0.0)
    poses = _poses(rig, 2000)
    shifts = np.array([pose.position for pose in poses])
    turns = np.degrees([pose.rotation_vector for pose in poses])
    # the spread of an estimate from 2000 is 1/sqrt(4000) = 1.6 %; four standard deviations
    assert shifts.std(axis=0) == pytest.approx([0.001] * 3, rel=0.064)
    assert turns.std(axis=0) == pytest.approx([0.5] * 3, rel=0.064)
    assert np.abs(shifts.mean(axis=0)).max() < 4 * 0.001 / 2000**0.5
    assert degrees(pi) > np.abs(turns).max()


def test_poses_are_dropped_at_the_given_rate() -> None:
    count = len(_poses(_rig(drop_fraction=0.3, latency_s=0.0), 2000))
    # binomial: the spread is sqrt(2000 x 0.3 x 0.7) = 20; four standard deviations
    assert count == pytest.approx(1400, abs=82)


@settings(max_examples=10)
@given(
    cuts=st.lists(st.integers(0, 150), max_size=8), rate_hz=st.sampled_from([30.0, 100.0, 700.0])
)
def test_slicing_a_sleep_changes_no_bit(cuts: list[int], rate_hz: float) -> None:
    """Cuts are on the 2 ms grid; some rates are not, and one is above it."""

    def end(moments: list[float]) -> tuple[Pose | None, bytes]:
        rig = _rig(rate_hz=rate_hz, drop_fraction=0.1)
        with rig:
            rig.actuators.enable()
            rig.clock.sleep_until(0.1)
            rig.actuators.exchange(Command(position=(0.3, -0.3), valid_for=9.0))
            for t in [*sorted(moments), 0.4]:
                rig.clock.sleep_until(t)
            assert rig.tracker is not None
            return rig.tracker.latest(), rig.plant.data.qpos.tobytes()

    assert end([0.1 + 0.002 * n for n in cuts]) == end([])


def test_tracking_changes_nothing_else() -> None:
    video = {"camera.jitter_s": 0.05, "camera.drop_fraction": 0.3, "camera.latency_s": 0.1}
    plain = scenario.load("random", video)
    watched = plain.model_copy(update={"tracker": PoseTrackerSettings()})

    def frames(of: Scenario) -> list[tuple[int, float]]:
        rig = TwinRig(of, pictures=False, seed=3)
        found = []
        for n in range(100):
            rig.clock.sleep_until(0.02 * n)
            if frame := rig.camera.latest():
                found.append((frame.seq, frame.t_available))
        return [*found, (-1, rig.plant.board_position()[0])]

    assert frames(watched) == frames(plain)
