"""The target lock as a Gymnasium environment; importing this module registers it.

    gymnasium.make("endolock.twin.env.gym_env:Endolock/TargetLock-v0")
    gymnasium.make("endolock.twin.env.gym_env:Endolock/TargetLock-Pixels-v0", scenario="circle")

It is `endolock.twin.env.target_lock` with the same observations, as float32, and the same reward;
actions are fractions of the handles' range, from -1 to 1. An episode is truncated at the scenario's
end.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from endolock.hw.api import PERIOD_S, ConfigError, Image, Vector
from endolock.twin.env import target_lock
from endolock.twin.rig import TwinRig
from endolock.twin.world.scenario import Scenario
from endolock.vision.observation import Eyes

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
        eyes: Callable[[TwinRig], Eyes] = target_lock.exact_eyes,
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ConfigError(f"render mode '{render_mode}' is unknown", "use rgb_array")
        self.render_mode = render_mode
        pictures = True if render_mode else None
        self._env = target_lock.make(scenario, pixels=pixels, eyes=eyes, pictures=pictures)
        goals = self._env.action_spec()
        self._low, self._high = goals.minimum, goals.maximum
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, goals.shape, np.float32)
        self.observation_space = gymnasium.spaces.Dict(
            {name: _box(spec) for name, spec in self._env.observation_spec().items()}
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: seed of the episode; None to draw one.
            options: not used.
        """
        super().reset(seed=seed)
        episode = int(self.np_random.integers(2**31)) if seed is None else seed
        self._env.physics.reseed(episode)
        return _observed(self._env.reset().observation), {}

    def step(self, action: Vector) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Turn the handles towards `action`, fractions of their range from -1 to 1, for 20 ms."""
        share = (np.asarray(action, np.float64) + 1.0) / 2.0
        step = self._env.step(self._low + share * (self._high - self._low))
        if step.first():
            raise gymnasium.error.ResetNeeded("the episode has ended or not begun; call reset()")
        return _observed(step.observation), step.reward, False, step.last(), {}

    def render(self) -> Image | None:
        """Return the newest delivered tip picture, black before the first; None without a mode."""
        rig: TwinRig = self._env.physics.rig
        if self.render_mode is None:
            return None
        frame, calibration = rig.camera.latest(), rig.camera.calibration
        if frame is None or frame.image is None:
            return np.zeros((calibration.height, calibration.width, 3), np.uint8)
        return frame.image.copy()

    def close(self) -> None:
        """Close the rig; may be called twice."""
        self._env.close()


def vector(count: int, **kwargs: Any) -> AsyncVectorEnv:
    """Make environments that run in parallel, each in its own process.

    A script must call this under `if __name__ == "__main__":`, because each process imports it.

    Args:
        count: number of environments.
        kwargs: arguments of each `TargetLockEnv`.
    """
    return gymnasium.make_vec(
        STATE_ID,
        count,
        gymnasium.VectorizeMode.ASYNC,
        vector_kwargs={"context": "spawn"},  # a forked process would share the OpenGL context
        **kwargs,
    )


def _box(spec: Any) -> gymnasium.spaces.Box:
    """Convert the specification of one array; numbers become float32."""
    kind = np.uint8 if spec.dtype == np.uint8 else np.float32
    low, high = (np.broadcast_to(bound, spec.shape) for bound in (spec.minimum, spec.maximum))
    return gymnasium.spaces.Box(low.astype(kind), high.astype(kind), dtype=kind)


def _observed(values: dict[str, Any]) -> dict[str, Any]:
    return {n: v if v.dtype == np.uint8 else v.astype(np.float32) for n, v in values.items()}


def _register() -> None:
    for name, pixels in ((STATE_ID, False), (PIXELS_ID, True)):
        gymnasium.register(name, f"{__name__}:{TargetLockEnv.__name__}", kwargs={"pixels": pixels})


_register()
