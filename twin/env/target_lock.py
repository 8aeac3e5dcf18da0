"""The target lock as a dm-control environment: two handle goals in, late vision and a reward out.

An episode is a run of `endolock run` with the agent as the controller: it starts at t = 0 with the
handles enabled, and an action is sent with the exchange of the next tick. `Physics` sleeps on the
clock of the rig and steps nothing itself. Observations contain only what a bench could measure; the
reward is computed from the truth.

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
"""Observations are clipped at this factor times the handle limits and half the picture. Assumed:
wide enough for overshoot, and for a target found outside the picture."""


def exact_eyes(rig: TwinRig) -> Eyes:
    """Make eyes that need no pictures, with the noise `camera.truth_noise_px` of the scenario."""
    noise_px = rig.scenario.camera.truth_noise_px
    return TruthEyes(rig.truth, noise_px, generator(rig.seed, "vision.noise"))


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

    def close(self) -> None:
        """Switch the handles off and release the OpenGL context; may be called twice."""
        self.rig.close()


class TargetLockTask(control.Task):  # type: ignore[misc]  # dm-control is untyped
    """Keep the target in the image centre; see the description of the module.

    The action is the two handle goals [rad], (up_down, left_right); the guard of the rig limits
    position and speed as for any controller. The observations are

        handle_position  (2,) [rad], handle_velocity (2,) [rad/s]: as measured
        target_error     (2,) [rad]: (above, right) of the image centre over the focal length, where
                         the target was last seen; positive handle angles reduce positive errors
        tracking         (1,): 1 if the newest frame showed the target, otherwise 0
        pixels           height x width x 3, uint8: the newest frame; black before the first
        frame_age        (1,) [s]: of the frame of target_error or pixels, as the camera estimates;
                         time since the start before the first frame

    There are target_error and tracking with eyes, pixels without.

    Args:
        make_eyes: makes the eyes of an episode; None to observe pixels.
    """

    def __init__(self, make_eyes: Callable[[TwinRig], Eyes] | None) -> None:
        self._make_eyes = make_eyes

    def initialize_episode(self, physics: Physics) -> None:
        """Expose the first frame, enable the handles and make the first observation."""
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
        """Store the action; it is sent with the next exchange, at the end of the period."""
        self._command = Command(position=tuple(float(goal) for goal in np.ravel(action)))

    def after_step(self, physics: Physics) -> None:
        """Send the action, read the handles, and observe the newest frame if it is new."""
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
        """Return the range of the handle goals [rad]."""
        low, high = np.transpose(physics.rig.actuators.limits.position_rad)
        return specs.BoundedArray((2,), np.float64, low, high, name="handle_goal")

    def observation_spec(self, physics: Physics) -> dict[str, specs.BoundedArray]:
        """Return shapes and bounds of all observations."""
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
        """Return the observations after the last exchange."""
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
        """Return the reward of the present true error."""
        return reward(physics.rig.truth.now().error_deg)

    def _names(self) -> tuple[str, ...]:
        handles = ("handle_position", "handle_velocity", "frame_age")
        return (*handles, "target_error", "tracking") if self._make_eyes else handles


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
    eyes: Callable[[TwinRig], Eyes] = exact_eyes,
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
    loaded = load(scenario)
    needed = pixels or eyes is not exact_eyes
    taken = needed if pictures is None else pictures
    periods = round(loaded.duration_s / PERIOD_S)
    return Environment(
        Physics(lambda seed: TwinRig(loaded, seed=seed, pictures=taken), seed),
        TargetLockTask(None if pixels else eyes),
        time_limit=(periods - 0.5) * PERIOD_S,  # half a period less, so that rounding cannot matter
        control_timestep=PERIOD_S,
    )


def reward(error_deg: float) -> float:
    """Return the reward of an error [deg], from 0 to 1; see the description of the module."""
    return 1.0 / (1.0 + (error_deg / HALF_ERROR_DEG) ** 2)


def _ranges(rig: TwinRig) -> dict[str, tuple[Vector, Vector]]:
    """Return the lowest and highest value of every observation but pixels."""
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
