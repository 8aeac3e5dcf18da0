"""One episode of the target lock: two handle goals in, late vision and a reward out.

An episode is a run of `endolock run` with the agent as the controller: it starts at t = 0 with the
handles enabled, an action is sent with the exchange of the next tick, and when the video stops for
`BLIND_S` the handles hold and actions are ignored until the next frame. Observations contain only
what a bench could measure; the reward is computed from the truth.

    reward = 1 / (1 + (error / HALF_ERROR_DEG)^2)

where the error is the true angle now between the optical axis and the ray to the target: 1 at the
centre, 1/2 at `HALF_ERROR_DEG`, above 0 everywhere. An episode ends by time alone.

The adapters for dm-control (`target_lock`) and Gymnasium (`gym_env`) need this module and not each
other.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from endolock.hw.api import (
    AXES,
    PERIOD_S,
    Command,
    CommandError,
    ConfigError,
    Image,
    State,
    Vector,
)
from endolock.twin.exact_eyes import exact_eyes
from endolock.twin.rig import TwinRig
from endolock.twin.world.scenario import Scenario
from endolock.vision import camera_model
from endolock.vision.observation import BLIND_S, Eyes, Status

HALF_ERROR_DEG = 5.0
"""Error at which the reward is one half [deg]; 23 px with f = 262 px. Assumed: about the 20 px
within which the target counts as locked."""
MARGIN = 2.0
"""Observations are clipped at this factor times the handle limits and half the picture. Assumed:
wide enough for overshoot, and for a target found outside the picture."""

MakeEyes = Callable[[TwinRig], Eyes]
"""Makes the eyes of an episode from its rig."""


def reward(error_deg: float) -> float:
    """Return the reward of an error [deg], from 0 to 1; see the description of the module."""
    return 1.0 / (1.0 + (error_deg / HALF_ERROR_DEG) ** 2)


def rig_maker(
    scenario: Scenario, eyes: MakeEyes | None, pictures: bool | None = None
) -> Callable[[int], TwinRig]:
    """Return a function that makes the rig of an episode from its seed.

    Args:
        scenario: what the episodes show.
        eyes: makes the eyes that will be used; None to observe pixels.
        pictures: whether frames carry pictures; None for only if they are needed.

    Raises:
        ConfigError: pixels are observed, and there are no pictures.
    """
    if eyes is None and pictures is False:
        raise ConfigError("pixels need pictures", "leave pictures out, or make it True")
    taken = eyes is not exact_eyes if pictures is None else pictures
    return lambda seed: TwinRig(scenario, seed=seed, pictures=taken)


def periods(scenario: Scenario) -> int:
    """Return the number of steps of an episode."""
    return round(scenario.duration_s / PERIOD_S)


class Episode:
    """An episode on a new rig, at its beginning: the first frame exposed, the handles enabled.

    The observations are

        handle_position  (2,) [rad], handle_velocity (2,) [rad/s]: as measured
        target_error     (2,) [rad]: (above, right) of the image centre over the focal length, where
                         the target was last seen; positive handle angles reduce positive errors
        tracking         (1,): 1 if the newest frame showed the target, otherwise 0
        pixels           height x width x 3, uint8: the newest frame; black before the first
        frame_age        (1,) [s]: of the frame of target_error or pixels, as the camera estimates;
                         time since the start before the first frame

    There are target_error and tracking with eyes, pixels without.

    Args:
        rig: a new rig; whoever made it closes it.
        make_eyes: makes the eyes of the episode; None to observe pixels.
    """

    def __init__(self, rig: TwinRig, make_eyes: MakeEyes | None) -> None:
        self._rig = rig
        self._eyes = make_eyes(rig) if make_eyes else None
        self._ranges = ranges(rig, eyes=make_eyes is not None)
        self._command: Command | None = None
        self._seq = -1
        self._picture = black(rig)
        self._error, self._tracking, self._seen_at = (0.0, 0.0), False, 0.0
        rig.clock.sleep_until(0.0)
        rig.actuators.connect()
        rig.actuators.enable()
        self._framed_at = rig.clock.now()
        self.tick()

    def act(self, action: ArrayLike) -> None:
        """Take an action, which is sent at the next tick.

        Args:
            action: goals of the two handles [rad], (up_down, left_right), shape (2,); the guard of
                the rig limits position and speed as for any controller.

        Raises:
            CommandError: its shape is another, or it is not finite; nothing has moved.
        """
        self._command = Command(position=tuple(self._checked(action).tolist()))

    def act_on_scale(self, action: ArrayLike) -> None:
        """Take an action in shares of the handles' range, from -1 to 1; otherwise as `act`."""
        low, high = goal_range(self._rig)
        share = np.clip(self._checked(action), -1.0, 1.0)
        self.act(low + (share + 1.0) / 2.0 * (high - low))

    def tick(self) -> None:
        """Send the action, read the handles, and observe the newest frame if it is new.

        To be called one control period after the last.

        Raises:
            HardwareError: the handles stopped, because of a following error for example.
        """
        rig, now = self._rig, self._rig.clock.now()
        if now - self._framed_at > BLIND_S:  # as in a run
            rig.actuators.hold()
            self._command, self._tracking = None, False
        self._state: State = rig.actuators.exchange(self._command)
        frame = rig.camera.latest()
        if frame is None or frame.seq == self._seq:
            return
        self._seq, self._framed_at = frame.seq, now
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

    def observation(self) -> dict[str, Vector | Image]:
        """Return the observations after the last tick, in arrays of their own."""
        values = {
            "handle_position": self._state.position,
            "handle_velocity": self._state.velocity,
            "frame_age": (self._state.t - self._seen_at,),
            "target_error": self._error,
            "tracking": (float(self._tracking),),
        }
        result: dict[str, Vector | Image] = {
            name: np.clip(values[name], *bounds) for name, bounds in self._ranges.items()
        }
        if self._eyes is None:
            result["pixels"] = self._picture.copy()
        return result

    def reward(self) -> float:
        """Return the reward of the present true error."""
        return reward(self._rig.truth.now().error_deg)

    def _checked(self, action: ArrayLike) -> Vector:
        try:
            goals = np.asarray(action)
        except ValueError:  # numpy's, of lists of different lengths
            goals = np.asarray(None)
        if goals.shape != (len(AXES),) or goals.dtype.kind not in "iuf":
            what = f"the action has shape {goals.shape} and type {goals.dtype}"
        elif not np.isfinite(goals).all():
            what = f"the action is {goals.tolist()}"
        else:
            return goals.astype(float)
        step = f"give {len(AXES)} finite numbers: {', '.join(AXES)}"
        raise CommandError(what, step, t=self._rig.clock.now())


def goal_range(rig: TwinRig) -> tuple[Vector, Vector]:
    """Return the lowest and highest goals of the handles [rad]."""
    low, high = np.transpose(rig.actuators.limits.position_rad)
    return low, high


def black(rig: TwinRig) -> Image:
    """Return a black picture of the size of the tip camera's."""
    calibration = rig.camera.calibration
    return np.zeros((calibration.height, calibration.width, 3), np.uint8)


def ranges(rig: TwinRig, *, eyes: bool) -> dict[str, tuple[Vector, Vector]]:
    """Return the lowest and highest value of every observation but pixels.

    Args:
        rig: a rig of an episode.
        eyes: whether there are observations made by eyes.
    """
    limits, camera = rig.actuators.limits, rig.camera.calibration
    low, high = MARGIN * np.transpose(limits.position_rad)
    speed = MARGIN * np.array(limits.velocity_rad_s)
    oldest = rig.scenario.duration_s + rig.scenario.camera.latency_s + PERIOD_S
    result = {
        "handle_position": (low, high),
        "handle_velocity": (-speed, speed),
        "frame_age": (np.zeros(1), np.array([oldest])),
    }
    if eyes:
        view = MARGIN / 2 * np.array([camera.height, camera.width]) / camera.focal_px
        result["target_error"] = (-view, view)
        result["tracking"] = (np.zeros(1), np.ones(1))
    return result
