"""Times of exposure, and the frames of a rig whose camera has all effects on."""

import hashlib
from itertools import islice
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.hw.api import ConfigError
from endolock.twin.camera.exposure import sub_exposures
from endolock.twin.rig import TwinRig
from endolock.twin.world import scenario
from endolock.twin.world.scenario_sections import CameraSettings
from endolock.vision.marker_eyes import MarkerEyes
from endolock.vision.observation import Status

TIMESTEP_S = 0.002


@given(
    rate=st.floats(5, 60), share=st.floats(0, 1), parts=st.integers(0, 5).map(lambda n: 2 * n + 1)
)
def test_sub_exposures_are_centred_on_their_frames_and_in_order(
    rate: float, share: float, parts: int
) -> None:
    camera = CameraSettings(
        frame_rate_hz=rate, exposure_s=min(0.1, share / rate), sub_exposures=parts
    )
    drawn = list(islice(sub_exposures(camera, TIMESTEP_S, pictures=True), 60))
    assert [m.step for m in drawn] == sorted(m.step for m in drawn)
    assert drawn[0].step >= 0
    for moment in drawn:
        off = moment.step * TIMESTEP_S - moment.seq / rate
        if moment.step:
            assert abs(off) <= camera.exposure_s / 2 + TIMESTEP_S  # rounded to the grid
        if moment.nominal:
            assert abs(off) <= TIMESTEP_S / 2 + 1e-9
    frames = drawn[-1].seq
    complete = [m for m in drawn if m.seq < frames]
    assert sum(m.nominal for m in complete) == sum(m.last for m in complete) == frames


def test_without_pictures_only_the_middle_counts() -> None:
    camera = CameraSettings(exposure_s=0.03)
    assert all(
        m.nominal and m.last for m in islice(sub_exposures(camera, 0.002, pictures=False), 9)
    )


@pytest.mark.parametrize(
    ("camera", "why"),
    [
        ({"camera.exposure_s": 0.05}, "exposure_s 0.05 is longer than a frame of 0.04 s"),
        ({"camera.sub_exposures": 4}, "sub_exposures 4 is even; use an odd number"),
        ({"board.target": 2}, "target 2: board rings has 1, from 0"),
    ],
)
def test_impossible_exposures_are_refused(camera: dict[str, Any], why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        scenario.load("straight", camera)


def test_a_blurred_target_is_at_its_position_in_mid_exposure() -> None:
    blur = {"camera.exposure_s": 0.03, "camera.latency_s": 0.0}
    fast = [{"kind": "jump", "direction_deg": 0.0, "travel_m": 0.08, "start_s": 0.0, "over_s": 2.0}]
    with TwinRig(scenario.load("rest", {**blur, "motion": fast})) as rig:
        eyes, off = MarkerEyes(rig.camera.calibration, rig.board), []
        for n in range(5, 25):
            rig.clock.sleep_until(0.04 * n + 0.02)
            frame = rig.camera.latest()
            assert frame is not None
            assert frame.seq == n
            seen = np.array(eyes(frame).target_px)
            off.append(seen - rig.truth.at_exposure(n).target_px)
    # 40 mm/s are 2.6 px an exposure; an error of half an exposure would show as 1.3 px
    assert np.abs(np.mean(off, axis=0)).max() < 0.1


def test_a_picture_with_motion_below_a_pixel_is_drawn_once() -> None:
    def picture(speed: float, parts: int) -> np.ndarray:
        jump = {"kind": "jump", "direction_deg": 0.0, "start_s": 0.0, "over_s": 1.0}
        camera = {"camera.exposure_s": 0.02, "camera.sub_exposures": parts}
        moving = {**camera, "camera.latency_s": 0.0, "motion": [{**jump, "travel_m": speed}]}
        with TwinRig(scenario.load("rest", moving)) as rig:
            rig.clock.sleep_until(0.53)
            frame = rig.camera.latest()
        assert frame is not None
        assert frame.image is not None
        return frame.image

    # one pixel in 20 ms: 1 px / 262 px x 120 mm / 20 ms = 23 mm/s, 12 of them on the average
    assert np.array_equal(picture(0.007, 3), picture(0.007, 1))
    assert not np.array_equal(picture(0.03, 3), picture(0.03, 1))


def test_the_fastest_speed_in_the_picture_is_estimated() -> None:
    def speed(**changes: Any) -> float:
        with TwinRig(scenario.load("rest", changes), pictures=False) as rig:
            rig.clock.sleep_until(1.0)
            return rig.plant.seen_speed()

    jump = {"kind": "jump", "direction_deg": 0.0, "travel_m": 0.01, "start_s": 0.0, "over_s": 2.0}
    with TwinRig(scenario.load("rest", {"motion": [jump]}), pictures=False) as rig:
        rig.clock.sleep_until(0.99)
        before = np.array(rig.truth.now().plant.board.position)
        rig.clock.sleep_until(1.01)
        moved = np.array(rig.truth.now().plant.board.position) - before
    angle = np.linalg.norm(moved) / 0.02 / 0.12
    assert speed(motion=[jump]) == pytest.approx(angle, rel=1e-2)  # its middle, straight ahead
    assert speed() < 1e-3  # the tip settles


def test_repeated_pictures_are_flagged_and_not_accepted() -> None:
    repeats = {"camera.repeat_fraction": 0.3, "camera.latency_s": 0.0}
    with TwinRig(scenario.load("circle", repeats)) as rig:
        eyes = MarkerEyes(rig.camera.calibration, rig.board)
        count, before = 0, None
        for n in range(50):
            rig.clock.sleep_until(0.04 * n)
            frame = rig.camera.latest()
            assert frame is not None
            assert frame.image is not None
            observation = eyes(frame)
            same = before is not None and np.array_equal(before, frame.image)
            assert frame.repeated is same  # the board moves, so other pictures differ
            assert (observation.status is Status.TRACKING) is not same
            if same:
                assert observation.why == "picture repeated"
            count += same
            before = frame.image
    assert 5 < count < 25  # 15 of 50; binomial with a standard deviation of 3.2


@pytest.mark.parametrize("cuts", [[], [0.013, 0.031, 0.037], [0.02 * n for n in range(14)]])
def test_slicing_a_sleep_changes_no_bit_of_the_pictures(cuts: list[float]) -> None:
    assert _digests(cuts) == _digests([0.1])


def _digests(cuts: list[float]) -> list[str]:
    with TwinRig(scenario.load("endoscope", {"camera.latency_s": 0.05}), seed=4) as rig:
        for t in cuts:
            rig.clock.sleep_until(t)
        found = []
        for n in range(1, 5):
            rig.clock.sleep_until(0.28 + 0.04 * n)
            frame = rig.camera.latest()
            assert frame is not None
            assert frame.image is not None
            found.append(hashlib.sha256(frame.image.tobytes()).hexdigest())
        return found
