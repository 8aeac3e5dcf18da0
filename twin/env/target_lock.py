"""The target lock as a dm-control environment: two handle goals in, late vision and a reward out.

An episode is what `endolock run` would record, with the agent in the place of the law: it starts at
t = 0 with the handles enabled, and an action goes out with the next tick's exchange. Time is the
rig's: the physics sleeps on the rig's clock and steps nothing itself. Nothing observed is more than
a bench could know; only the reward is taken from the truth.

    reward = 1 / (1 + (error / HALF_ERROR_DEG)^2)

where the error is the true angle now between the optical axis and the ray to the target: 1 at the
centre, 1/2 at `HALF_ERROR_DEG`, above 0 everywhere. An episode ends by time alone (discount 1).

Reference:
    S. Tunyasuvunakool et al., dm_control: Software and tasks for continuous control, Software
    Impacts 6, 2020.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from endolock.hw.api import PERIOD_S, Command, ConfigError, Image, State, Vector
from endolock.twin.randomness import generator
from endolock.twin.rig import TwinRig
from endolock.twin.world.scenario import Scenario, load
from endolock.vision import camera_model
from endolock.vision.observation import Eyes, Status
from endolock.vision.truth_eyes import TruthEyes

try:
    from dm_control.rl import control
    from dm_env import specs
except ModuleNotFoundError:
    raise ConfigError(
        "endolock.twin.env.target_lock needs dm-control, which is not installed",
        "use Python 3.11 or 3.12, where it comes with endolock",
    ) from None

HALF_ERROR_DEG = 5.0
"""Error at which the reward is one half [deg]; 23 px with f = 262 px. Assumed: about the 20 px
within which the target counts as locked."""
MARGIN = 2.0
"""Observations are clipped at so many times the handles' limits and half the picture. Assumed:
overshoot stays within, and so does a target found outside the picture."""


def exact_eyes(rig: TwinRig) -> Eyes:
    """Make eyes that need no pictures, with the noise `camera.truth_noise_px` of the scenario."""
    noise_px = rig.scenario.camera.truth_noise_px
    return TruthEyes(rig.truth, noise_px, generator(rig.seed, "vision.noise"))


class Physics(control.Physics):  # type: ignore[misc]  # dm-control is untyped
    """A rig as dm-control sees it; each reset makes a new one.

    Args:
        make_rig: makes a rig from its seed.
        seed: of the first episode, >= 0; those after it draw theirs from it.
    """

    def __init__(self, make_rig: Callable[[int], TwinRig], seed: int) -> None:
        self._make_rig = make_rig
        self.rig = make_rig(seed)  # specifications are asked for before the first reset
        self.reseed(seed)

    def reseed(self, seed: int) -> None:
        """Give the next episode this seed, and those after it the same ones as the first time."""
        self._next = seed
        self._later = generator(seed, "env.episodes")

    def step(self, n_sub_steps: int = 1) -> None:
        """Let so many steps of the clock's grid pass."""
        clock = self.rig.clock
        clock.sleep_until(clock.now() + n_sub_steps * clock.timestep_s)

    def time(self) -> float:
        """Time since the episode began [s]."""
        return self.rig.clock.now()

    def timestep(self) -> float:
        """Grid of the clock [s]."""
        return self.rig.clock.timestep_s

    def reset(self) -> None:
        """Replace the rig by a new one, with the next seed."""
        self.close()
        self.rig = self._make_rig(self._next)
        self._next = int(self._later.integers(2**31))

    def after_reset(self) -> None:
        """Nothing to do: the rig is as new."""

    def close(self) -> None:
        """Switch the handles off and give the OpenGL context back; may be called twice."""
        self.rig.close()


class TargetLockTask(control.Task):  # type: ignore[misc]  # dm-control is untyped
    """Keep the target in the image centre, see the module's description.

    The action is the two handle goals [rad], (up_down, left_right); the guard of the rig limits and
    slews them like anyone's. Observed are

        handle_position  (2,) [rad], handle_velocity (2,) [rad/s]: as measured
        target_error     (2,) [rad]: (above, right) of the image centre over the focal length, where
                         the target was last seen; a positive handle makes a positive error smaller
        tracking         (1,): 1 where the newest frame showed the target, else 0
        pixels           height x width x 3, uint8: the newest frame; black before the first
        frame_age        (1,) [s]: of the frame that target_error or pixels are from, as the camera
                         believes; time since the start before there is one

    target_error and tracking with eyes, pixels without.

    Args:
        make_eyes: makes the eyes of an episode; None to observe pixels.
    """

    def __init__(self, make_eyes: Callable[[TwinRig], Eyes] | None) -> None:
        self._make_eyes = make_eyes

    def initialize_episode(self, physics: Physics) -> None:
        """Expose the first frame, enable the handles and look for the first time."""
        rig = physics.rig
        calibration = rig.camera.calibration
        self._eyes = self._make_eyes(rig) if self._make_eyes else None
        self._ranges = _ranges(rig)
        self._command: Command | None = None
        self._seq = -1
        self._picture: Image = np.zeros((calibration.height, calibration.width, 3), np.uint8)
        self._error, self._tracking, self._seen_at = (0.0, 0.0), False, 0.0
        rig.clock.sleep_until(0.0)
        rig.actuators.connect()
        rig.actuators.enable()
        self.after_step(physics)

    def before_step(self, action: Vector, physics: Physics) -> None:
        """Take the action; it is sent with the next exchange, when the period is over."""
        self._command = Command(position=tuple(float(goal) for goal in np.ravel(action)))

    def after_step(self, physics: Physics) -> None:
        """Send the action, read the handles, and look at the frame if a new one has come."""
        rig = physics.rig
        self._state: State = rig.actuators.exchange(self._command)
        frame = rig.camera.latest()
        if frame is None or frame.seq == self._seq:
            return
        self._seq = frame.seq
        if self._eyes is None:
            assert frame.image is not None
            self._picture, self._seen_at = frame.image, frame.t_capture
            return
        observation, calibration = self._eyes(frame), rig.camera.calibration
        self._tracking = observation.status is Status.TRACKING
        if self._tracking:
            right, down = camera_model.offset(calibration, observation.target_px)
            self._error = (-down / calibration.focal_px, right / calibration.focal_px)
            self._seen_at = observation.t_capture

    def action_spec(self, physics: Physics) -> specs.BoundedArray:
        """Return the handle goals that are possible [rad]."""
        low, high = np.transpose(physics.rig.actuators.limits.position_rad)
        return specs.BoundedArray((2,), np.float64, low, high, name="handle_goal")

    def observation_spec(self, physics: Physics) -> dict[str, specs.BoundedArray]:
        """Return shapes and bounds of everything observed."""
        ranges = _ranges(physics.rig)
        result = {
            name: specs.BoundedArray(ranges[name][0].shape, np.float64, *ranges[name], name=name)
            for name in self._names()
        }
        if self._make_eyes is None:
            calibration = physics.rig.camera.calibration
            shape = (calibration.height, calibration.width, 3)
            result["pixels"] = specs.BoundedArray(shape, np.uint8, 0, 255, name="pixels")
        return result

    def get_observation(self, physics: Physics) -> dict[str, Vector | Image]:
        """Return what is known after the last exchange."""
        values = {
            "handle_position": self._state.position,
            "handle_velocity": self._state.velocity,
            "frame_age": (self._state.t - self._seen_at,),
            "target_error": self._error,
            "tracking": (float(self._tracking),),
        }
        result: dict[str, Vector | Image] = {
            name: np.clip(values[name], *self._ranges[name]) for name in self._names()
        }
        if self._eyes is None:
            result["pixels"] = self._picture.copy()
        return result

    def get_reward(self, physics: Physics) -> float:
        """Return the reward of the true error now."""
        return reward(physics.rig.truth.now().error_deg)

    def _names(self) -> tuple[str, ...]:
        handles = ("handle_position", "handle_velocity", "frame_age")
        return (*handles, "target_error", "tracking") if self._make_eyes else handles


class Environment(control.Environment):  # type: ignore[misc]  # dm-control is untyped
    """A `dm_control.rl.control.Environment` that knows its rewards and gives its rig back."""

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
    eyes: Callable[[TwinRig], Eyes] = exact_eyes,
    pictures: bool | None = None,
    seed: int = 0,
) -> Environment:
    """Make the environment of one scenario; an episode lasts as long as the scenario.

    Args:
        scenario: name, TOML file or loaded scenario; smaller pictures are a scenario with another
            `camera.width` and `camera.height`.
        pixels: observe the delayed tip picture instead of what eyes make of it.
        eyes: makes the eyes of an episode from its rig, for example
            `lambda rig: MarkerEyes(rig.camera.calibration, rig.board)`.
        pictures: whether frames carry pictures; None for where they are looked at.
        seed: of the first episode, >= 0; one seed and the same actions give the same episodes.

    Raises:
        ConfigError: the scenario or the seed cannot be used.
    """
    loaded = load(scenario)
    needed = pixels or eyes is not exact_eyes
    taken = needed if pictures is None else pictures
    periods = round(loaded.duration_s / PERIOD_S)
    return Environment(
        Physics(lambda seed: TwinRig(loaded, seed=seed, pictures=taken), seed),
        TargetLockTask(None if pixels else eyes),
        time_limit=(periods - 0.5) * PERIOD_S,  # half a period off, where rounding cannot matter
        control_timestep=PERIOD_S,
    )


def reward(error_deg: float) -> float:
    """Return the reward of an error [deg], from 0 to 1; see the module's description."""
    return 1.0 / (1.0 + (error_deg / HALF_ERROR_DEG) ** 2)


def _ranges(rig: TwinRig) -> dict[str, tuple[Vector, Vector]]:
    """Bounds of every observation that is a number, lowest and highest."""
    limits, camera = rig.actuators.limits, rig.camera.calibration
    low, high = MARGIN * np.transpose(limits.position_rad)
    speed = MARGIN * np.array(limits.velocity_rad_s)
    view = MARGIN / 2 * np.array([camera.height, camera.width]) / camera.focal_px
    oldest = rig.scenario.duration_s + rig.scenario.camera.latency_s + PERIOD_S
    return {
        "handle_position": (low, high),
        "handle_velocity": (-speed, speed),
        "frame_age": (np.zeros(1), np.array([oldest])),
        "target_error": (-view, view),
        "tracking": (np.zeros(1), np.ones(1)),
    }
