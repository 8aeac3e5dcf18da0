"""The Gymnasium environments pass the checker and equal those of dm-control."""

import multiprocessing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests import traps

from endolock.hw.api import ConfigError
from endolock.twin.world import scenario

pytestmark = pytest.mark.extra

SMALL = scenario.load(
    "circle", {"duration_s": 0.4, "camera.latency_s": 0.1, "camera.width": 64, "camera.height": 48}
)


@pytest.fixture(scope="module")
def gymnasium() -> Any:
    """Gymnasium with the environments registered; imported late, because it may be missing."""
    import gymnasium

    import endolock.twin.env.gym_env  # noqa: F401

    return gymnasium


@pytest.mark.parametrize("name", ["Endolock/TargetLock-v0", "Endolock/TargetLock-Pixels-v0"])
def test_the_checker_of_gymnasium_passes(gymnasium: Any, name: str) -> None:
    from gymnasium.utils.env_checker import check_env

    made = gymnasium.make(f"endolock.twin.env.gym_env:{name}")
    check_env(made.unwrapped)  # its warnings are errors here
    made.close()


def test_it_equals_the_dm_control_environment(gymnasium: Any) -> None:
    pytest.importorskip("dm_control", reason="pip installs no dm-control on Python 3.13 and later")
    from endolock.twin.env import target_lock

    made = gymnasium.make("Endolock/TargetLock-v0", scenario=SMALL)
    actions = np.random.default_rng(0).uniform(-1, 1, (20, 2)).astype(np.float32)
    with target_lock.make(SMALL, seed=5) as ours:
        observed, _ = made.reset(seed=5)
        expected = ours.reset()
        for action in actions:
            assert observed.keys() == expected.observation.keys()
            for name, value in expected.observation.items():
                assert observed[name] == pytest.approx(value, abs=1e-6)  # float32
            observed, reward, terminated, truncated, _ = made.step(action)
            expected = ours.step(action.astype(float) * np.pi)
            assert reward == pytest.approx(expected.reward, abs=1e-9)  # rounding of the action
            assert not terminated
        assert truncated == expected.last() is True
    with pytest.raises(gymnasium.error.ResetNeeded):
        made.step(actions[0])
    made.close()


@pytest.mark.parametrize(
    "action", [0.5, [0.5], [0.5] * 3, [[0.5, 0.5]], [[0.5], [0.5]], [np.nan, 0.5], ["a", "b"], None]
)
def test_a_bad_action_is_a_value_error(gymnasium: Any, action: Any) -> None:
    made = gymnasium.make("Endolock/TargetLock-v0", scenario=SMALL).unwrapped
    with pytest.raises(gymnasium.error.ResetNeeded):
        made.step(np.zeros(2))
    made.reset(seed=0)
    with pytest.raises(ValueError, match="give 2 finite numbers: up_down, left_right"):
        made.step(action)
    made.close()


def test_an_action_beyond_the_ends_of_the_range_is_one_at_its_ends(gymnasium: Any) -> None:
    observed = []
    for action in ([1.0, -1.0], [3.0, -1e308]):
        made = gymnasium.make("Endolock/TargetLock-v0", scenario=SMALL).unwrapped
        made.reset(seed=0)
        observed.append([made.step(action)[0]["handle_position"].tolist() for _ in range(10)])
        made.close()
    assert observed[0] == observed[1]


def test_reset_takes_a_seed_and_no_options(gymnasium: Any) -> None:
    noisy = scenario.load(SMALL, {"camera.jitter_s": 0.05})
    made = gymnasium.make("Endolock/TargetLock-v0", scenario=noisy).unwrapped
    with pytest.raises(ConfigError, match="reset has no option scenario; give parameters when"):
        made.reset(seed=3, options={"scenario": "circle"})

    def ages(**options: Any) -> list[float]:
        made.reset(**options)
        return [float(made.step([0.0, 0.0])[0]["frame_age"][0]) for _ in range(15)]

    first, second = ages(seed=3, options={}), ages()
    assert first != second  # drawn from the seed
    assert [ages(seed=3), ages()] == [first, second]
    made.close()


@pytest.mark.filterwarnings("ignore::UserWarning")  # of Gymnasium, which tells of errors so too
def test_parallel_pictures_in_forked_processes_are_refused(gymnasium: Any) -> None:
    from endolock.twin.env.gym_env import PIXELS_ID
    from endolock.twin.rig import TwinRig

    with TwinRig(SMALL) as rig:
        rig.clock.sleep_until(0.0)  # renders in this process
    forked = gymnasium.make_vec(
        PIXELS_ID, 2, "async", scenario=SMALL, vector_kwargs={"context": "fork"}
    )
    try:
        with pytest.raises(ConfigError, match="use the start method spawn"):
            forked.reset(seed=0)
    finally:
        forked.close(terminate=True)


def test_render_shows_what_pixels_observe(gymnasium: Any) -> None:
    made = gymnasium.make("Endolock/TargetLock-Pixels-v0", scenario=SMALL, render_mode="rgb_array")
    observed, _ = made.reset(seed=0)
    assert not made.render().any()
    for _ in range(10):
        observed, *_ = made.step(np.zeros(2, np.float32))
    assert np.array_equal(made.render(), observed["pixels"])
    assert observed["pixels"].shape == (48, 64, 3)
    made.close()
    with pytest.raises(ConfigError, match="render mode 'human' is unknown; use rgb_array"):
        type(made.unwrapped)(render_mode="human")


def test_parallel_environments_have_own_seeds_and_equal_single_ones(
    gymnasium: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from endolock.twin.env import gym_env

    traps.lay(tmp_path)
    monkeypatch.chdir(tmp_path)

    noisy = scenario.load("circle", {"camera.latency_s": 0.1, "camera.jitter_s": 0.05})
    actions = np.random.default_rng(0).uniform(-1, 1, (20, 2, 2)).astype(np.float32)
    several = gym_env.vector(2, scenario=noisy)
    single = gymnasium.make("Endolock/TargetLock-v0", scenario=noisy)
    try:
        several.reset(seed=3)
        single.reset(seed=4)
        for both in actions:
            observed, rewards, *_ = several.step(both)
            alone, reward, *_ = single.step(both[1])
            assert {name: value[1].tobytes() for name, value in observed.items()} == {
                name: value.tobytes() for name, value in alone.items()
            }
            assert rewards[1] == reward
        assert observed["frame_age"][0] != observed["frame_age"][1]  # jitter of another seed
    finally:
        several.close()
        single.close()
    assert not multiprocessing.active_children()
    assert not traps.sprung(tmp_path)


def test_the_speed_benchmark_runs(gymnasium: Any) -> None:
    from endolock.scripts.speed import environment_speed

    figures = environment_speed.environments()
    assert set(figures) == {"steps_per_s", "vector_steps_per_s", "environments"}
    assert all(value > 0 for value in figures.values())
