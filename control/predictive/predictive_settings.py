"""Settings of the predictive lock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import StrictBool

from endolock.control.transmission.linear_process import COMMAND_DELAY_S, LAG_S, Depth
from endolock.hw.api import ConfigError
from endolock.hw.strict import bounded
from endolock.hw.strict_fields import settle

MOST_PREDICTORS = 16
"""Most constant-velocity predictors [1]. Assumed."""


@dataclass(frozen=True, kw_only=True)
class PredictiveSettings:
    """Prior knowledge of the controller, and how quickly it adapts."""

    target_distance_m: Depth = 0.12
    """Depth of the target until markers measure it [m], 0.001 to 10. Source: 12 cm, thesis ch.
    6."""
    walk_density: Annotated[float, bounded(1e-9, 1e3, "rad2/s")] = 0.02
    """Spectral density of the target's random walk [rad2/s], 1e-9 to 1e3. Assumed."""
    densities: tuple[Annotated[float, bounded(1e-9, 1e6, "rad2/s3")], ...] = (0.02, 0.5)
    """Spectral density of the acceleration in each constant-velocity predictor [rad2/s3], 1e-9 to
    1e6. Assumed: one for slow and one for fast turns of the target."""
    harmonic: StrictBool = True
    """Whether periodic motion is searched for."""
    noise_px: Annotated[float, bounded(0.001, 1000, "px")] = 0.5
    """Smallest standard deviation of target_px [px], 0.001 to 1000. Assumed: five times that of
    markers."""
    latency_uncertainty_s: Annotated[float, bounded(0, 5, "s")] = 0.02
    """Standard deviation of exposure times [s], 0 to 5: frames count less while the handles move,
    without a background. Assumed."""
    lead_s: Annotated[float, bounded(0, 5, "s")] = LAG_S + COMMAND_DELAY_S
    """Delay from command to motion [s], 0 to 5: servo, tip, one and a half control periods."""
    capstan: StrictBool = True
    """Whether a capstan model is searched for, in addition to the plays."""
    dead_zones: StrictBool = True
    """Whether dead zones are fitted, in addition to plays."""
    background: StrictBool = True
    """Whether the camera's rotation, measured on the background, is used."""
    regression: StrictBool = True
    """Whether the target's place is regressed on its past."""

    def __post_init__(self) -> None:
        settle(self, "predictive")
        if not 1 <= len(self.densities) <= MOST_PREDICTORS:
            raise ConfigError(
                f"predictive: {len(self.densities)} densities, wanted 1 to {MOST_PREDICTORS}",
                "give one for each predictor",
            )


@dataclass(frozen=True, kw_only=True)
class SinglePredictiveSettings(PredictiveSettings):
    """Settings with a single constant-velocity predictor."""

    densities: tuple[Annotated[float, bounded(1e-9, 1e6, "rad2/s3")], ...] = (0.02,)
    """Spectral density of the acceleration in each constant-velocity predictor [rad2/s3], 1e-9 to
    1e6. Assumed."""
    harmonic: StrictBool = False
    """Whether periodic motion is searched for."""
    regression: StrictBool = False
    """Whether the target's place is regressed on its past."""
