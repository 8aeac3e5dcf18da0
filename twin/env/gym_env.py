"""The target lock as a Gymnasium environment; importing this module registers it.

    gymnasium.make("endolock.twin.env.gym_env:Endolock/TargetLock-v0")
    gymnasium.make("endolock.twin.env.gym_env:Endolock/TargetLock-Pixels-v0", scenario="circle")

Observations, as float32, and reward are those of `endolock.twin.env.episode`; actions are fractions
of the handles' range, from -1 to 1. An episode is truncated at the scenario's end. dm-control is
not needed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from endolock.hw.api import AXES, PERIOD_S, ConfigError, Image
from endolock.hw.child_processes import safe_path
from endolock.twin.env import episode
from endolock.twin.env.episode import Episode, MakeEyes
from endolock.twin.exact_eyes import exact_eyes
from endolock.twin.world.scenario import Scenario, load

try:
    import gymnasium
    from gymnasium.vector import AsyncVectorEnv
except ModuleNotFoundError:
    raise ConfigError(
        "endolock.twin.env.gym_env needs Gymnasium, which is not installed",
        "use pip install 'endolock[gym]'",
    ) from None

STATE_ID = "Endolock/TargetLock-v0"
PIXELS_ID = "Endolock/TargetLock-Pixels-v0"


class TargetLockEnv(gymnasium.Env):  # type: ignore[misc]  # an extra, so types are not checked
    """Keep the target in the image centre by turning the two handles.

    Args:
        scenario: name, TOML file or loaded scenario.
        pixels: observe the delayed tip picture instead of the result of vision.
        eyes: makes the eyes of an episode from its rig; by default they use the truth.
        render_mode: "rgb_array" to render the newest delivered tip picture, None for no rendering.

    Raises:
        ConfigError: the scenario or the render mode cannot be used.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "render_modes": ["rgb_array"],
        "render_fps": round(1 / PERIOD_S),
    }

    def __init__(
        self,
        scenario: str | Path | Scenario = "straight",
        *,
        pixels: bool = False,
        eyes: MakeEyes = exact_eyes,
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ConfigError(f"render mode '{render_mode}' is unknown", "use rgb_array")
        self.render_mode = render_mode
        self._eyes = None if pixels else eyes
        loaded = load(scenario)
        self._make_rig = episode.rig_maker(loaded, self._eyes, True if render_mode else None)
        self._periods, self._left = episode.periods(loaded), 0
        self._episode: Episode | None = None
        self._rig = self._make_rig(0)  # spaces are needed before the first reset
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (len(AXES),), np.float32)
        ranges = episode.ranges(self._rig, eyes=self._eyes is not None)
        spaces = {
            name: gymnasium.spaces.Box(*(bound.astype(np.float32) for bound in bounds))
            for name, bounds in ranges.items()
        }
        if pixels:
            shape = episode.black(self._rig).shape
            spaces["pixels"] = gymnasium.spaces.Box(0, 255, shape, np.uint8)
        self.observation_space = gymnasium.spaces.Dict(spaces)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: seed of the episode; None to draw one.
            options: there are none; None or empty.

        Raises:
            ConfigError: there are options.
        """
        if options:
            names = ", ".join(map(str, options))
            raise ConfigError(
                f"reset has no option {names}", "give parameters when the environment is made"
            )
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(2**31)) if seed is None else seed
        self.close()
        self._rig = self._make_rig(drawn)
        self._episode, self._left = Episode(self._rig, self._eyes), self._periods
        return _observed(self._episode.observation()), {}

    def step(self, action: ArrayLike) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Turn the handles towards `action` for 20 ms.

        Args:
            action: fractions of the handles' range, (up_down, left_right), shape (2,), from -1 to
                1; the handles stop at the ends of their range if it is beyond.

        Raises:
            CommandError, a ValueError: its shape is another, or it is not finite; nothing moved.
            ResetNeeded: the episode has ended or not begun.
        """
        if self._episode is None or not self._left:
            raise gymnasium.error.ResetNeeded("the episode has ended or not begun; call reset()")
        self._episode.act_on_scale(action)
        self._rig.clock.sleep_until(self._rig.clock.now() + PERIOD_S)
        self._episode.tick()
        self._left -= 1
        observed = _observed(self._episode.observation())
        return observed, self._episode.reward(), False, not self._left, {}

    def render(self) -> Image | None:
        """Return the newest delivered tip picture, black before the first; None without a mode."""
        if self.render_mode is None:
            return None
        frame = self._rig.camera.latest()
        if frame is None or frame.image is None:
            return episode.black(self._rig)
        return frame.image.copy()

    def close(self) -> None:
        """Close the rig, which ends the episode; may be called twice."""
        self._episode = None
        self._rig.close()


def vector(count: int, **kwargs: Any) -> AsyncVectorEnv:
    """Make environments that run in parallel, each in its own process.

    A script must call this under `if __name__ == "__main__":`, because each process imports it.

    Args:
        count: number of environments.
        kwargs: arguments of each `TargetLockEnv`.
    """
    with safe_path():
        return gymnasium.make_vec(
            STATE_ID,
            count,
            gymnasium.VectorizeMode.ASYNC,
            vector_kwargs={"context": "spawn"},  # a forked process would share the OpenGL context
            **kwargs,
        )


def _observed(values: dict[str, Any]) -> dict[str, Any]:
    return {n: v if v.dtype == np.uint8 else v.astype(np.float32) for n, v in values.items()}


def _register() -> None:
    for name, pixels in ((STATE_ID, False), (PIXELS_ID, True)):
        gymnasium.register(name, f"{__name__}:{TargetLockEnv.__name__}", kwargs={"pixels": pixels})


_register()
