"""The target lock as a dm-control environment: two handle goals in, late vision and a reward out.

Observations, reward and the end of an episode are those of `endolock.twin.env.episode`. `Physics`
sleeps on the clock of the rig and steps nothing itself.

Reference:
    S. Tunyasuvunakool et al., dm_control: Software and tasks for continuous control, Software
    Impacts 6, 2020.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from endolock.hw.api import PERIOD_S, ConfigError, Image, Vector
from endolock.twin.env import episode
from endolock.twin.env.episode import HALF_ERROR_DEG as HALF_ERROR_DEG
from endolock.twin.env.episode import Episode, MakeEyes
from endolock.twin.env.episode import reward as reward
from endolock.twin.exact_eyes import exact_eyes as exact_eyes
from endolock.twin.randomness import generator
from endolock.twin.rig import TwinRig
from endolock.twin.world.scenario import Scenario, load

try:
    from dm_control.rl import control
    from dm_env import specs
except ModuleNotFoundError:
    raise ConfigError(
        "endolock.twin.env.target_lock needs dm-control, which is not installed",
        "use Python 3.11 or 3.12, where it comes with endolock, or endolock.twin.env.gym_env",
    ) from None


class Physics(control.Physics):  # type: ignore[misc]  # dm-control is untyped
    """Adapts a rig to dm-control; each reset makes a new rig.

    Args:
        make_rig: makes a rig from its seed.
        seed: seed of the first episode, >= 0; the seeds of later ones are drawn from it.
    """

    def __init__(self, make_rig: Callable[[int], TwinRig], seed: int) -> None:
        self._make_rig = make_rig
        self.rig = make_rig(seed)  # specifications are asked for before the first reset
        self.reseed(seed)

    def reseed(self, seed: int) -> None:
        """Set the seed of the next episode, and restart the sequence of the later seeds."""
        self._next = seed
        self._later = generator(seed, "env.episodes")

    def step(self, n_sub_steps: int = 1) -> None:
        """Advance by this number of steps of the clock's grid."""
        clock = self.rig.clock
        clock.sleep_until(clock.now() + n_sub_steps * clock.timestep_s)

    def time(self) -> float:
        """Return the time since the episode began [s]."""
        return self.rig.clock.now()

    def timestep(self) -> float:
        """Return the grid of the clock [s]."""
        return self.rig.clock.timestep_s

    def reset(self) -> None:
        """Replace the rig by a new one with the next seed."""
        self.close()
        self.rig = self._make_rig(self._next)
        self._next = int(self._later.integers(2**31))

    def after_reset(self) -> None:
        """Do nothing: the rig is new."""

    def render(self, height: int = 240, width: int = 320, camera_id: int | str = -1) -> Image:
        """Draw what a camera sees now, as dm-control's own physics does; observes nothing.

        Args:
            height: height [px].
            width: width [px].
            camera_id: name or number of a camera; -1, which is dm-control's default, for overview.

        Raises:
            ConfigError: there is no such camera, the picture is too large, or pictures cannot be
                rendered here.
        """
        return self.rig.draw("overview" if camera_id == -1 else camera_id, width, height)

    def close(self) -> None:
        """Switch the handles off and release the OpenGL context; may be called twice."""
        self.rig.close()


class TargetLockTask(control.Task):  # type: ignore[misc]  # dm-control is untyped
    """Keep the target in the image centre; see `Episode` for actions and observations.

    Args:
        make_eyes: makes the eyes of an episode; None to observe pixels.
    """

    def __init__(self, make_eyes: MakeEyes | None) -> None:
        self._make_eyes = make_eyes

    def initialize_episode(self, physics: Physics) -> None:
        """Expose the first frame, enable the handles and make the first observation."""
        self._episode = Episode(physics.rig, self._make_eyes)

    def before_step(self, action: ArrayLike, physics: Physics) -> None:
        """Take the action; it is sent with the next exchange, at the end of the period.

        Raises:
            CommandError: it is not two finite numbers.
        """
        self._episode.act(action)

    def after_step(self, physics: Physics) -> None:
        """Send the action, read the handles, and observe the newest frame if it is new."""
        self._episode.tick()

    def action_spec(self, physics: Physics) -> specs.BoundedArray:
        """Return the range of the handle goals [rad]."""
        low, high = episode.goal_range(physics.rig)
        return specs.BoundedArray(low.shape, np.float64, low, high, name="handle_goal")

    def observation_spec(self, physics: Physics) -> dict[str, specs.BoundedArray]:
        """Return shapes and bounds of all observations."""
        ranges = episode.ranges(physics.rig, eyes=self._make_eyes is not None)
        result = {
            name: specs.BoundedArray(bounds[0].shape, np.float64, *bounds, name=name)
            for name, bounds in ranges.items()
        }
        if self._make_eyes is None:
            shape = episode.black(physics.rig).shape
            result["pixels"] = specs.BoundedArray(shape, np.uint8, 0, 255, name="pixels")
        return result

    def get_observation(self, physics: Physics) -> dict[str, Vector | Image]:
        """Return the observations after the last exchange."""
        return self._episode.observation()

    def get_reward(self, physics: Physics) -> float:
        """Return the reward of the present true error."""
        return self._episode.reward()


class Environment(control.Environment):  # type: ignore[misc]  # dm-control is untyped
    """A `dm_control.rl.control.Environment` with bounds of its reward, and that closes its rig."""

    def reward_spec(self) -> specs.BoundedArray:
        """Return the bounds of the reward."""
        return specs.BoundedArray((), np.float64, 0.0, 1.0, name="reward")

    def close(self) -> None:
        """Close the rig; may be called twice."""
        self.physics.close()


def make(
    scenario: str | Path | Scenario = "straight",
    *,
    pixels: bool = False,
    eyes: MakeEyes = exact_eyes,
    pictures: bool | None = None,
    seed: int = 0,
) -> Environment:
    """Make the environment of one scenario; an episode lasts as long as the scenario.

    Args:
        scenario: name, TOML file or loaded scenario; the size of the pictures is its `camera.width`
            and `camera.height`.
        pixels: observe the delayed tip picture instead of the result of vision.
        eyes: makes the eyes of an episode from its rig, for example
            `lambda rig: MarkerEyes(rig.camera.calibration, rig.board)`.
        pictures: whether frames carry pictures; None for only if they are needed.
        seed: seed of the first episode, >= 0; the same seed and actions give the same episodes.

    Raises:
        ConfigError: the scenario or the seed cannot be used.
    """
    loaded, observing = load(scenario), None if pixels else eyes
    return Environment(
        Physics(episode.rig_maker(loaded, observing, pictures), seed),
        TargetLockTask(observing),
        # Half a period less, so that rounding cannot matter.
        time_limit=(episode.periods(loaded) - 0.5) * PERIOD_S,
        control_timestep=PERIOD_S,
    )
