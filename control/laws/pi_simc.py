"""PI with gains by the SIMC rules, tuned to the assumed distance and the measured latency.

The rules need gain, lag and dead time of the loop. The gain follows from the section's lengths and
the assumed distance, the dead time from the age of the frames, so the controller tunes itself to
the present latency.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from endolock.control.laws.pi import PI, PIMemory
from endolock.control.transmission import linear_process
from endolock.control.transmission.kinematics import SectionGeometry
from endolock.control.transmission.linear_process import Process
from endolock.hw.api import Calibration, Command, State
from endolock.hw.strict import bounded
from endolock.hw.strict_fields import settle
from endolock.vision.observation import Observation

SETTLING = 0.1
"""Weight of the newest frame's age in the mean, which averages jitter [1]."""


@dataclass(frozen=True, kw_only=True)
class SimcSettings:
    """Assumptions of the tuning."""

    target_distance_m: linear_process.Depth = 0.12
    """Depth of the target [m], 0.001 to 10. Source: 12 cm, thesis ch. 6."""
    bend_per_handle: linear_process.Slope = linear_process.BEND_PER_HANDLE
    """Slope of the transmission [rad/rad], 0.001 to 100. Assumed."""
    latency_s: Annotated[float, bounded(0, 30, "s")] = 0.4
    """Latency of the video until the first frame [s], 0 to 30. Source: thesis ch. 7."""

    def __post_init__(self) -> None:
        settle(self, "pi_simc")


@dataclass
class SimcMemory(PIMemory):
    """State of the controller."""

    age_s: float | None = None
    """Mean age of the frames on delivery [s]."""


class SimcPI(PI):
    """PI controller that tunes itself to the age of the frames.

    Args:
        calibration: turns pixels into angles.
        settings: assumptions of the tuning; the defaults if None.
        geometry: lengths of the section; the defaults if None.
    """

    memory: SimcMemory

    def __init__(
        self,
        calibration: Calibration,
        settings: SimcSettings | None = None,
        geometry: SectionGeometry | None = None,
    ) -> None:
        super().__init__(calibration)
        self._settings = settings or SimcSettings()
        made = geometry or SectionGeometry()
        distance, slope = self._settings.target_distance_m, self._settings.bend_per_handle
        self._gain = linear_process.image_gain(made, distance, slope)
        self.memory = SimcMemory()
        self._tune()

    def reset(self, state: State) -> None:
        """Start from the present goals of the handles, and keep the measured latency."""
        position = state.goal[0], state.goal[1]
        self.memory = SimcMemory(integral=position, age_s=self.memory.age_s)

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Update the gains with the age of the frame, and control; see `Controller.update`."""
        if observation is not None:
            self.memory.age_s = mean_age(self.memory.age_s, t - observation.t_capture)
        self._tune()
        return super().update(t, state, observation)

    def _tune(self) -> None:
        age = self._settings.latency_s if self.memory.age_s is None else self.memory.age_s
        dead_s = max(age, 0.0) + linear_process.HOLD_S
        self.gains = linear_process.simc(Process(gain=self._gain, dead_s=min(dead_s, 10.0)))


def mean_age(mean_s: float | None, age_s: float) -> float:
    """Return the mean age including one more frame [s]."""
    return age_s if mean_s is None else mean_s + SETTLING * (age_s - mean_s)
