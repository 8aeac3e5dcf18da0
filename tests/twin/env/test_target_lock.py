"""The dm-control environment: contract, late vision without leaks, reproducible episodes."""

import unittest
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from endolock.control import loop
from endolock.control.laws.pi import PI
from endolock.hw.api import CommandError, ConfigError, Frame, Vector
from endolock.twin.rig import TwinRig
from endolock.twin.world import scenario
from endolock.vision.marker_eyes import MarkerEyes
from endolock.vision.observation import Eyes
from endolock.vision.truth_eyes import TruthEyes

pytest.importorskip("dm_control", reason="pip installs no dm-control on Python 3.13 and later")
from dm_env import test_utils

from endolock.twin.env import target_lock

SMALL = {"camera.width": 64, "camera.height": 48}


def _load(name: str, **camera: float) -> scenario.Scenario:
    return scenario.load(name, {f"camera.{key}": value for key, value in camera.items()})


class Contract(test_utils.EnvironmentTestMixin, unittest.TestCase):  # type: ignore[misc]  # untyped
    """Contract of every dm_env environment."""

    __test__ = False
    pixels = False

    def make_object_under_test(self) -> target_lock.Environment:
        """Make an environment of short episodes."""
        short = scenario.load("circle", {"duration_s": 0.2, "camera.latency_s": 0.1} | SMALL)
        return target_lock.make(short, pixels=self.pixels)

    def make_action_sequence(self) -> Iterator[Vector]:
        """Act at random for more than two episodes of ten steps."""
        spec = self.environment.action_spec()
        random = np.random.default_rng(0)
        for _ in range(25):
            yield random.uniform(spec.minimum, spec.maximum)


class TestState(Contract):
    """With eyes."""

    __test__ = True


class TestPixels(Contract):
    """With pictures."""

    __test__ = True
    pixels = True


def _episode(
    made: target_lock.Environment, actions: Iterable[Sequence[float] | Vector]
) -> list[Any]:
    return [made.reset(), *(made.step(action) for action in actions)]


def _bits(steps: list[Any]) -> list[Any]:
    return [
        (s.step_type, s.reward, s.discount, {k: v.tobytes() for k, v in s.observation.items()})
        for s in steps
    ]


def test_reward_is_one_at_the_centre_and_a_half_at_half_error() -> None:
    with target_lock.make("rest") as made:
        made.reset()
        assert made.step((0.0, 0.0)).reward == pytest.approx(1.0, abs=1e-6)  # 5 mdeg of sag
    assert target_lock.reward(0.0) == 1.0
    assert target_lock.reward(target_lock.HALF_ERROR_DEG) == 0.5
    rewards = [target_lock.reward(error) for error in np.linspace(0, 180, 100)]
    assert rewards == sorted(rewards, reverse=True)
    assert rewards[-1] > 0


def test_an_episode_equals_the_run_with_the_same_commands() -> None:
    late = _load("straight", jitter_s=0.03, drop_fraction=0.2)
    with TwinRig(late, pictures=False, seed=4) as rig:
        rig.clock.sleep_until(0.0)
        ran = loop.run(rig, TruthEyes(rig.truth), PI(rig.camera.calibration), duration_s=2.0)
    with target_lock.make(late, seed=4) as made:
        steps = _episode(made, [t.command.position for t in ran.ticks[1:] if t.command])
    assert len(steps) == len(ran.ticks) == 101
    for step, tick in zip(steps, ran.ticks, strict=True):
        assert tuple(step.observation["handle_position"]) == tick.state.position
        assert tick.truth
        assert step.first() or step.reward == target_lock.reward(tick.truth.error_deg)


@pytest.mark.parametrize("pixels", [False, True])
def test_one_seed_and_the_same_actions_give_the_same_episodes(pixels: bool) -> None:
    noisy = _load("circle", jitter_s=0.05, drop_fraction=0.3, latency_s=0.1, width=64, height=48)
    actions = np.random.default_rng(1).uniform(-1, 1, (40, 2))

    def two(seed: int) -> list[list[Any]]:
        with target_lock.make(noisy, pixels=pixels, seed=seed) as made:
            return [_bits(_episode(made, actions)) for _ in range(2)]

    first, second = two(7)
    assert two(7) == [first, second]
    assert first != second  # other noise in every episode
    assert two(8)[0] != first


def test_the_current_target_is_not_observed() -> None:
    # Until the first frame arrives, two targets at different positions must look the same.
    steps = {}
    for name in ("rest", "circle"):
        with target_lock.make(_load(name, latency_s=1.0)) as made:
            steps[name] = _episode(made, np.full((49, 2), 0.3))
    for one, other in zip(steps["rest"], steps["circle"], strict=True):
        assert _bits([one])[0][3] == _bits([other])[0][3]
        assert one.first() or one.reward != other.reward


def test_the_picture_is_late_by_its_age() -> None:
    with target_lock.make("circle", pixels=True) as made:
        step = made.reset()
        while made.physics.time() < 0.399:
            assert not step.observation["pixels"].any()  # nothing has arrived yet
            assert step.observation["frame_age"][0] == pytest.approx(made.physics.time())
            step = made.step((0.3, 0.2))
        for _ in range(25):
            step = made.step((0.3, 0.2))
        rig: TwinRig = made.physics.rig
        (age,) = step.observation["frame_age"]
        assert 0.4 - 1e-9 <= age <= 0.44 + 1e-9  # the latency and up to a frame; rounding
        exposed = made.physics.time() - age
        frame = Frame(
            image=step.observation["pixels"], t_capture=exposed, t_available=0, seq=0, dropped=0
        )
        seen = MarkerEyes(rig.camera.calibration, rig.board)(frame)
        then = rig.truth.at_exposure(round(exposed * 25))
        assert then.t == pytest.approx(exposed)
        assert seen.target_px == pytest.approx(then.target_px, abs=0.5)  # marker noise and tilt
        now = rig.truth.now().target_px
        assert np.hypot(*np.subtract(now, then.target_px)) > 5  # it has moved on since


def test_the_error_is_above_and_right_for_both_kinds_of_eyes() -> None:
    def marker_eyes(rig: TwinRig) -> Eyes:
        return MarkerEyes(rig.camera.calibration, rig.board)

    right = scenario.load(
        "rest",
        {
            "camera.latency_s": 0.0,
            "motion": [{"kind": "circle", "radius_m": 0.02, "period_s": 1e6}],
        },
    )
    seen = []
    for eyes in (target_lock.exact_eyes, marker_eyes):
        with target_lock.make(right, eyes=eyes) as made:
            seen.append(made.reset().observation)
    for observed in seen:
        # 20 mm to the right at 120 mm; 0.5 px of 262 px for the markers
        assert observed["target_error"] == pytest.approx((0.0, 0.02 / 0.12), abs=0.002)
        assert observed["tracking"] == 1


def test_a_target_behind_an_occluder_is_not_tracked() -> None:
    plate = {
        "size_m": [0.02, 0.02],
        "distance_m": 0.06,
        "position_m": [0.0, 0.1],
        "to_m": [0.0, 0.0],
        "start_s": 0.2,
        "over_s": 0.2,
    }
    covered = scenario.load("rest", {"camera.latency_s": 0.0, "occluder": [plate]})
    with target_lock.make(covered) as made:
        steps = _episode(made, np.zeros((30, 2)))
    tracking = [bool(step.observation["tracking"][0]) for step in steps]
    # half the plate's 20 mm are over the axis from 0.38 s on; frames come every 0.04 s
    assert all(tracking[:19])
    assert not any(tracking[21:])


def test_exact_eyes_have_the_noise_of_the_scenario() -> None:
    pixels = {}
    for noise_px in (0.0, 3.0):
        noisy = _load("rest", latency_s=0.0, truth_noise_px=noise_px)
        with target_lock.make(noisy, seed=5) as made:
            steps = _episode(made, np.zeros((400, 2)))
            focal_px = made.physics.rig.camera.calibration.focal_px
        pixels[noise_px] = focal_px * np.array([s.observation["target_error"] for s in steps[::2]])
    assert np.ptp(pixels[0.0], axis=0).max() < 0.05  # the section settles by 5 mdeg
    assert pixels[3.0].std(axis=0) == pytest.approx([3.0, 3.0], rel=0.2)  # 200 frames: 5 % each


def test_turning_by_the_error_brings_the_target_nearer() -> None:
    with target_lock.make(_load("circle", latency_s=0.0)) as made:
        first = made.reset().observation["target_error"]
        for _ in range(100):
            step = made.step(first)  # about the handle angle that bends the section by it
        assert np.abs(step.observation["target_error"][1]) < np.abs(first[1]) / 2


def test_the_last_error_is_kept_and_ages_when_the_target_is_lost() -> None:
    with target_lock.make(_load("rest", latency_s=0.1)) as made:
        made.reset()
        seen: list[Any] = []
        lost: list[Any] = []
        for _ in range(100):
            observed = made.step((3.0, 0.0)).observation
            (seen if observed["tracking"] else lost).append(observed)
    assert len(seen) > 5
    assert len(lost) > 50
    late = lost[10:]
    ages = [observed["frame_age"][0] for observed in late]
    assert np.diff(ages) == pytest.approx(loop.PERIOD_S)
    assert all(np.array_equal(o["target_error"], seen[-1]["target_error"]) for o in late)


def test_wild_actions_stay_within_the_specifications() -> None:
    with target_lock.make(_load("straight", jitter_s=0.1, drop_fraction=0.1)) as made:
        actions, observed = made.action_spec(), made.observation_spec()
        assert tuple(actions.maximum) == pytest.approx((np.pi, np.pi))
        made.reset()
        random = np.random.default_rng(2)
        corners = np.array([actions.minimum, actions.maximum])
        for n in range(400):
            if n % 40 == 0:  # between the ends, held long enough to avoid a following error
                action = corners[random.integers(2, size=2), [0, 1]]
            step = made.step(actions.validate(action))
            for name, spec in observed.items():
                spec.validate(step.observation[name])
            made.reward_spec().validate(step.reward)


def test_an_episode_ends_with_its_scenario() -> None:
    with target_lock.make(scenario.load("rest", {"duration_s": 0.3})) as made:
        steps = _episode(made, np.zeros((15, 2)))
        assert [s.last() for s in steps] == [False] * 15 + [True]
        assert steps[-1].discount == 1.0  # the end of time is no failure
        assert made.step((0.0, 0.0)).first()


def test_physics_renders_what_is_there_now_and_changes_nothing() -> None:
    def run(*, render: bool) -> list[Any]:
        with target_lock.make(scenario.load("circle", SMALL), pixels=True, seed=3) as made:
            bits = _bits([made.reset()])
            for _ in range(15):
                if render:
                    image = made.physics.render(camera_id="tip")
                    image[:] = 0
                bits += _bits([made.step((0.3, 0.2))])
        return bits

    assert run(render=True) == run(render=False)
    with target_lock.make("circle") as made:
        made.reset()
        for _ in range(20):
            made.step((0.3, 0.2))
        rig, render = made.physics.rig, made.physics.render
        image = render(480, 640, "tip")  # the size of this scenario's camera, which is a pinhole
        frame = Frame(image=image, t_capture=0.4, t_available=0.4, seq=0, dropped=0)
        seen = MarkerEyes(rig.camera.calibration, rig.board)(frame)
        # marker noise and tilt
        assert seen.target_px == pytest.approx(rig.truth.now().target_px, abs=0.5)
        assert render().shape == (240, 320, 3)  # dm-control's defaults
        assert np.array_equal(render(), render(camera_id="overview"))
        assert not np.array_equal(render(), render(camera_id="tip"))
        for wrong in ({"camera_id": "tipp"}, {"camera_id": 7}, {"camera_id": -2}):
            with pytest.raises(ConfigError, match=r"use (tip, overview|overview, tip)"):
                render(**wrong)
        for width, height in ((0, 240), (320, -1), (5000, 240), (320, 481)):
            with pytest.raises(ConfigError, match="use at most 640x480"):
                render(height, width)


def test_physics_sleeps_on_the_clock_of_the_rig() -> None:
    with target_lock.make("rest") as made:
        made.reset()
        made.physics.step(7)
        rig = made.physics.rig
        assert made.physics.time() == rig.clock.now() == pytest.approx(7 * rig.clock.timestep_s)


@pytest.mark.parametrize("action", [(np.nan, 0.0), (0.0,), ((0.0, 0.0),), (0.0, 0.0, 0.0), 0.0])
def test_a_bad_action_is_refused_before_anything_moves(action: Any) -> None:
    with target_lock.make("rest") as made:
        made.reset()
        with pytest.raises(CommandError, match="give 2 finite numbers") as caught:
            made.step(action)
        assert isinstance(caught.value, ValueError)
        assert made.physics.time() == 0.0


def test_a_bad_seed_is_refused() -> None:
    with pytest.raises(ConfigError, match="seed -1"):
        target_lock.make("rest", seed=-1)
