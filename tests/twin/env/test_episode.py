"""Episodes see what a run sees, and hand out nothing that can change them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from endolock.control import loop
from endolock.hw.api import Command, CommandError, ConfigError, State, Vector
from endolock.scripts.runs import rigs
from endolock.twin.env import episode
from endolock.twin.env.episode import Episode
from endolock.twin.exact_eyes import exact_eyes
from endolock.twin.rig import TwinRig
from endolock.twin.world import scenario
from endolock.twin.world.scenario import Scenario
from endolock.vision import camera_model
from endolock.vision.observation import Observation, Status

PLATE = {
    "size_m": [0.1, 0.1],
    "distance_m": 0.06,
    "position_m": [0.0, 0.2],
    "to_m": [0.0, 0.0],
    "start_s": 0.6,
    "over_s": 0.2,
}
LATE = {
    "camera.latency_s": 0.2,
    "camera.nominal_latency_s": 0.15,
    "camera.jitter_s": 0.05,
    "camera.repeat_fraction": 0.2,
    "camera.truth_noise_px": 2.0,
}
HARD = scenario.load("circle", {**LATE, "camera.drop_fraction": 0.3, "occluder": [PLATE]})
STOPPING = scenario.load("circle", {**LATE, "camera.drop_fraction": 0.97})
"""Its video stops for more than 2 s with the seed used."""
PICTURES = scenario.load("circle", {**LATE, "camera.width": 64, "camera.height": 48})
SEED = 4


class Scripted:
    """Sends given goals, one a tick."""

    def __init__(self, goals: Vector) -> None:
        self._goals = goals

    def reset(self, state: State) -> None:
        """Keep the script."""

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Return the goals of this tick."""
        return Command(position=tuple(self._goals[round(t / loop.PERIOD_S)]))


class Film:
    """Keeps what was seen in each tick of a run."""

    def __init__(self) -> None:
        self.by_tick: list[loop.Seen | None] = []
        self._newest: loop.Seen | None = None

    def seen(self, seen: loop.Seen) -> None:
        """Keep the frame of this tick."""
        self._newest = seen

    def tick(self, tick: loop.Tick) -> None:
        """End the tick."""
        self.by_tick.append(self._newest)
        self._newest = None


def _goals(count: int) -> Vector:
    """Smooth motions, to both sides."""
    t = loop.PERIOD_S * np.arange(count)
    return 0.5 * np.sin(np.outer(t, (3.0, 2.0)) + (0.0, 1.0))


def _rig(scene: Scenario, *, pictures: bool = False) -> TwinRig:
    return TwinRig(scene, seed=SEED, pictures=pictures)


def _step(made: Episode, rig: TwinRig, action: Any) -> dict[str, Any]:
    made.act(action)
    rig.clock.sleep_until(rig.clock.now() + loop.PERIOD_S)
    made.tick()
    return made.observation()


@pytest.mark.parametrize(("scene", "duration_s"), [(HARD, 2.0), (STOPPING, 7.0)])
def test_an_episode_sees_what_a_run_sees(scene: Scenario, duration_s: float) -> None:
    goals = _goals(round(duration_s / loop.PERIOD_S) + 1)
    with _rig(scene) as rig:
        rig.clock.sleep_until(0.0)
        eyes, film = rigs.eyes_of(rig, "truth", scene, SEED), Film()
        ran = loop.run(rig, eyes, Scripted(goals), duration_s=duration_s, recorder=film)
        calibration = rig.camera.calibration
    error, seen_at = (0.0, 0.0), 0.0
    with _rig(scene) as rig:
        made = Episode(rig, exact_eyes)
        observed = made.observation()
        for n, (tick, seen) in enumerate(zip(ran.ticks, film.by_tick, strict=True)):
            if n:
                observed = _step(made, rig, goals[n - 1])
            if seen and seen.observation.status is Status.TRACKING:
                right, down = camera_model.offset(calibration, seen.observation.target_px)
                error = -down / calibration.focal_px, right / calibration.focal_px
                seen_at = seen.observation.t_capture
            assert tuple(observed["handle_position"]) == tick.state.position
            assert tuple(observed["handle_velocity"]) == tick.state.velocity
            assert observed["tracking"] == (tick.status is Status.TRACKING)
            assert tuple(observed["target_error"]) == pytest.approx(error, abs=1e-12)  # rounding
            assert observed["frame_age"] == pytest.approx(max(tick.t - seen_at, 0.0), abs=1e-12)
            assert tick.truth
            assert made.reward() == episode.reward(tick.truth.error_deg)
    kinds = {tick.status for tick in ran.ticks}
    assert Status.TRACKING in kinds  # otherwise it shows nothing
    assert kinds & {Status.COASTING, Status.LOST}
    held = [tick for tick in ran.ticks[1:] if tick.command is None]
    assert (len(held) > 20) == (scene is STOPPING)


def test_pixels_are_the_pictures_of_a_run() -> None:
    goals = _goals(40)
    with _rig(PICTURES, pictures=True) as rig:
        rig.clock.sleep_until(0.0)
        film = Film()
        loop.run(rig, exact_eyes(rig), Scripted(goals), duration_s=0.7, recorder=film)
    newest: Any = np.zeros((48, 64, 3), np.uint8)
    with _rig(PICTURES, pictures=True) as rig:
        made = Episode(rig, None)
        for n, seen in enumerate(film.by_tick):
            if n:
                _step(made, rig, goals[n - 1])
            newest = seen.frame.image if seen else newest
            assert np.array_equal(made.observation()["pixels"], newest)
    assert newest.any()


@pytest.mark.parametrize(
    "action",
    [
        *(0.1, [], [0.1], [0.1] * 3, [[0.1, 0.1]], [[0.1], [0.1]], np.zeros((2, 2)), None),
        *([[0.1], [0.1, 0.2]], ["0.1", "0.1"], "ab", {0.1, 0.2}, [True, False], [0.1j, 0.0]),
        *([np.nan, 0.0], [0.0, np.inf], [None, None]),
    ],
)
def test_anything_but_two_finite_numbers_is_refused_before_it_moves(action: Any) -> None:
    with _rig(HARD) as rig:
        made = Episode(rig, exact_eyes)
        for act in (made.act, made.act_on_scale):
            with pytest.raises(CommandError, match="give 2 finite numbers: up_down, left_right"):
                act(action)
        assert rig.clock.now() == 0.0


@pytest.mark.parametrize("action", [(0.1, 0.2), [np.float32(0.1), 1], np.array([1, 0], np.int8)])
def test_two_numbers_of_any_kind_are_taken(action: Sequence[float]) -> None:
    with _rig(HARD) as rig:
        _step(Episode(rig, exact_eyes), rig, action)


def test_goals_beyond_the_limits_are_those_at_the_limits() -> None:
    def positions(beyond: float) -> list[Any]:
        with _rig(HARD) as rig:
            made = Episode(rig, exact_eyes)
            low, high = episode.goal_range(rig)
            goals = np.array([high[0] + beyond, low[1] - beyond])
            return [tuple(_step(made, rig, goals)["handle_position"]) for _ in range(20)]

    assert positions(1e6) == positions(0.0)


@pytest.mark.parametrize("eyes", [exact_eyes, None])
def test_what_is_handed_out_is_a_copy(eyes: episode.MakeEyes | None) -> None:
    goals = _goals(20)

    def run(*, spoil: bool) -> list[Any]:
        seen = []
        with _rig(PICTURES, pictures=eyes is None) as rig:
            made = Episode(rig, eyes)
            for goal in goals:
                action = goal.copy()
                made.act(action)
                if spoil:
                    action[:] = 9.9
                rig.clock.sleep_until(rig.clock.now() + loop.PERIOD_S)
                made.tick()
                observed = made.observation()
                seen.append({name: value.tobytes() for name, value in observed.items()})
                for value in (*observed.values(), *episode.goal_range(rig)):
                    if spoil and value.flags.writeable:
                        value[...] = 77
        return seen

    assert run(spoil=True) == run(spoil=False)


def test_pixels_without_pictures_are_refused() -> None:
    with pytest.raises(ConfigError, match="pixels need pictures"):
        episode.rig_maker(HARD, None, pictures=False)
