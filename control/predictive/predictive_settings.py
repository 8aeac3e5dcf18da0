"""Settings of the predictive lock."""

from __future__ import annotations

from dataclasses import dataclass

from endolock.control.transmission.linear_process import COMMAND_DELAY_S, LAG_S
from endolock.hw.api import ConfigError


@dataclass(frozen=True, kw_only=True)
class PredictiveSettings:
    """Prior knowledge of the controller, and how quickly it adapts."""

    target_distance_m: float = 0.12
    """Depth of the target until markers measure it [m], > 0. Source: 12 cm, thesis ch. 6."""
    walk_density: float = 0.02
    """Spectral density of the target's random walk [rad2/s], > 0. Assumed."""
    densities: tuple[float, ...] = (0.02, 0.5)
    """Spectral density of the acceleration in each constant-velocity predictor [rad2/s3], > 0.
    Assumed: one for slow and one for fast turns of the target."""
    harmonic: bool = True
    """Whether periodic motion is searched for."""
    noise_px: float = 0.5
    """Smallest standard deviation of target_px [px], > 0. Assumed: five times that of markers."""
    latency_uncertainty_s: float = 0.02
    """Standard deviation of exposure times [s], >= 0: frames count less while the handles move.
    Assumed."""
    lead_s: float = LAG_S + COMMAND_DELAY_S
    """Delay from command to motion [s], >= 0: servo, tip, one and a half control periods."""
    reversal_rad: float = 0.001
    """Changes of the desired bend below this do not reverse the handles [rad], >= 0."""
    identify_every_s: float = 2.0
    """Time between identifications [s], > 0; longer than the run leaves the initial model."""
    capstan: bool = True
    """Whether a capstan model is searched for, in addition to the plays."""
    damping: float = 0.8
    """Fraction of the step from the old to the identified weights [1], 0 to 1."""
    busy_per_s: float = 3.0
    """Reversals per second above which it becomes cautious, until there are half as many, > 0.
    Assumed: strokes have 0.5."""
    swing_rad: float = 0.1
    """Motion back that counts as a reversal [rad], > 0. Assumed: less is noise."""

    def __post_init__(self) -> None:
        positive = (self.target_distance_m, self.walk_density, *self.densities, self.noise_px)
        good = min(*positive, self.identify_every_s, self.busy_per_s) > 0
        good &= min(self.latency_uncertainty_s, self.lead_s, self.reversal_rad, self.damping) >= 0
        if not (good and self.densities and self.damping <= 1 and self.swing_rad > 0):
            raise ConfigError(
                "predictive: a setting is out of range",
                "use distance, densities, noise_px, identify_every_s, busy_per_s and swing_rad "
                "above 0, the rest 0 or more, damping at most 1",
            )


@dataclass(frozen=True, kw_only=True)
class SinglePredictiveSettings(PredictiveSettings):
    """Settings with a single constant-velocity predictor."""

    densities: tuple[float, ...] = (0.02,)
    """Spectral density of the acceleration in each constant-velocity predictor [rad2/s3], > 0.
    Assumed."""
    harmonic: bool = False
    """Whether periodic motion is searched for."""
