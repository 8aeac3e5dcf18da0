"""PI with gains by the SIMC rules, tuned to the distance and to the latency that is met.

The rules want gain, lag and dead time of the loop. The gain follows from the section's lengths and
the assumed distance, the dead time from the age of the frames themselves, so the law is tuned for
whatever latency it meets.
"""

from __future__ import annotations

from dataclasses import dataclass

from endolock.control.laws.pi import PI, PIMemory
from endolock.control.transmission import linear_process
from endolock.control.transmission.kinematics import SectionGeometry
from endolock.control.transmission.linear_process import Process
from endolock.hw.api import Calibration, Command, ConfigError, State
from endolock.vision.observation import Observation

SETTLING = 0.1
"""Share of the newest frame's age in the mean: jitter averages out."""


@dataclass(frozen=True, kw_only=True)
class SimcSettings:
    """What the tuning believes."""

    target_distance_m: float = 0.12
    """Depth of the target [m], > 0. Source: 12 cm, thesis ch. 6."""
    bend_per_handle: float = linear_process.BEND_PER_HANDLE
    """Slope of the transmission [rad/rad], > 0. Assumed."""
    latency_s: float = 0.4
    """Of the video, until the first frame tells its age [s], >= 0. Source: thesis ch. 7."""

    def __post_init__(self) -> None:
        if not min(self.target_distance_m, self.bend_per_handle) > 0 or self.latency_s < 0:
            raise ConfigError(
                f"distance {self.target_distance_m:g} m, slope {self.bend_per_handle:g}, latency "
                f"{self.latency_s:g} s: use a distance and a slope above 0, a latency of 0 or more"
            )


@dataclass
class SimcMemory(PIMemory):
    """What the law remembers."""

    age_s: float | None = None
    """Mean age of the frames when they come [s]."""


class SimcPI(PI):
    """PI law that tunes itself to the frames' age.

    Args:
        calibration: turns pixels into angles.
        settings: what the tuning believes; the defaults if None.
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
        """Start from where the handles are; what is known of the video stays."""
        position = state.position[0], state.position[1]
        self.memory = SimcMemory(integral=position, age_s=self.memory.age_s)

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Learn from the frame's age, and control; see `Controller.update`."""
        if observation is not None:
            self.memory.age_s = mean_age(self.memory.age_s, t - observation.t_capture)
        self._tune()
        return super().update(t, state, observation)

    def _tune(self) -> None:
        age = self._settings.latency_s if self.memory.age_s is None else self.memory.age_s
        dead_s = max(age, 0.0) + linear_process.HOLD_S
        self.gains = linear_process.simc(Process(gain=self._gain, dead_s=min(dead_s, 10.0)))


def mean_age(mean_s: float | None, age_s: float) -> float:
    """Take the age of one more frame into the mean [s]."""
    return age_s if mean_s is None else mean_s + SETTLING * (age_s - mean_s)
