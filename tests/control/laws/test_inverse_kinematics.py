"""Inverse kinematics: its aim, its rate, and its behaviour without a target."""

from dataclasses import replace

import numpy as np
import pytest

from endolock.control.laws.inverse_kinematics import IKSettings, InverseKinematics
from endolock.control.loop import run
from endolock.control.transmission import kinematics
from endolock.hw.api import ConfigError, Mode, State
from endolock.twin.rig import TwinRig
from endolock.vision import camera_model
from endolock.vision.observation import Observation, Status
from endolock.vision.truth_eyes import TruthEyes

CAMERA = camera_model.from_fovy(640, 480, 85.0)
AT_REST = State(
    t=0.0,
    t_err=0.0,
    seq=0,
    position=(0.0, 0.0),
    velocity=(0.0, 0.0),
    current=(0.0, 0.0),
    goal=(0.0, 0.0),
    clipped=(0, 0),
    fresh=True,
    mode=Mode.ENABLED,
    device_tick=0,
)


def _seen(right: float, down: float, status: Status = Status.TRACKING) -> Observation:
    u, v = CAMERA.centre_px
    return Observation(t_capture=0.0, seq=0, status=status, target_px=(u + right, v + down))


def test_it_aims_at_the_assumed_position_of_the_target() -> None:
    law = InverseKinematics(CAMERA, IKSettings(rate_per_s=5.0))
    law.reset(AT_REST)
    law.update(0.0, AT_REST, _seen(90.0, -40.0))
    for n in range(1, 200):
        command = law.update(0.02 * n, AT_REST, None)
    ray = np.array([90.0, -40.0, CAMERA.focal_px]) / CAMERA.focal_px
    bend = kinematics.aim(kinematics.SectionGeometry(), 0.12 * ray)
    # 0.9 of the way is left 200 times: 1e-9 of it
    assert command.position == pytest.approx(np.divide(bend, 0.97), abs=1e-6)
    assert command.position[0] > 0  # above the centre: turn up
    assert command.position[1] > 0  # right of it: turn right


def test_it_approaches_its_aim_at_its_rate() -> None:
    law = InverseKinematics(CAMERA, IKSettings(rate_per_s=2.0))
    law.reset(AT_REST)
    law.update(0.0, AT_REST, _seen(50.0, 0.0))
    first = law.update(0.02, AT_REST, None).position[1]
    second = law.update(0.04, AT_REST, None).position[1]
    assert second - first == pytest.approx(first * (1 - 2.0 * 0.02))


@pytest.mark.parametrize("status", [Status.SEARCHING, Status.COASTING, Status.LOST])
def test_without_a_target_it_holds(status: Status) -> None:
    law = InverseKinematics(CAMERA)
    turned = replace(AT_REST, position=(0.3, -0.2), goal=(0.31, -0.21))  # a load pulls it back
    law.reset(turned)
    nan = float("nan")
    assert law.update(0.0, turned, _seen(nan, nan, status)).position == (0.31, -0.21)
    law.update(0.02, turned, _seen(80.0, 0.0))
    gone = law.update(0.04, turned, _seen(nan, nan, status)).position
    assert law.update(0.06, turned, None).position == gone


def test_a_target_at_rest_is_brought_to_the_centre() -> None:
    with TwinRig("circle", pictures=False) as rig:
        # the slowest of circles stands still at its right end, 60 mm off
        motion = rig.scenario.motion[0].model_copy(update={"period_s": 1e6})
    still = rig.scenario.model_copy(update={"motion": (motion,)})
    with TwinRig(still, pictures=False) as rig:
        law = InverseKinematics(rig.camera.calibration)
        result = run(rig, TruthEyes(rig.truth), law, duration_s=12.0)
    truth = result.ticks[-1].truth
    assert truth
    # 12 s are ten time constants of the loop; it starts 131 px off
    assert np.hypot(*camera_model.offset(CAMERA, truth.target_px)) < 3


@pytest.mark.parametrize("name", ["target_distance_m", "bend_per_handle", "rate_per_s"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("inf"), float("nan")])
def test_impossible_settings_are_refused(name: str, value: float) -> None:
    with pytest.raises(
        ConfigError, match=rf"ik: {name}: (got|should be a finite number, got) {value:g}"
    ):
        IKSettings(**{name: value})  # type: ignore[arg-type]


def test_a_measured_distance_replaces_the_assumed_one() -> None:
    """A target at 6 cm is aimed at exactly; assumed at 12 cm, the aim is farther out."""
    bends = {}
    for measured in (False, True):
        law = InverseKinematics(CAMERA, IKSettings(measured_distance=measured))
        law.reset(AT_REST)
        law.update(0.0, AT_REST, replace(_seen(100.0, 0.0), distance_m=0.06))
        bends[measured] = law.memory.aim[1] * IKSettings().bend_per_handle
    place = np.array([0.06 * 100 / CAMERA.focal_px, 0.0, 0.06])
    assert bends[True] == pytest.approx(
        kinematics.aim(kinematics.SectionGeometry(), place)[1], abs=1e-12
    )
    assert bends[False] > 1.2 * bends[True]  # the lever of the section is 52 mm
