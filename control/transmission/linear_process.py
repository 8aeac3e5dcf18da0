"""Linear model of a target lock: response of the error to the handles, with lag and dead time.

Near the image centre and away from reversals, the error e falls by K per radian of handle, with a
lag T (servo and tip) and a dead time L (video, frame, tick):

    e(s) = target(s) - K exp(-L s) / (T s + 1) handle(s)

Reference:
    S. Skogestad, J. Process Control 13, 2003 (SIMC rules).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from endolock.control.transmission.kinematics import SectionGeometry
from endolock.hw.api import ConfigError
from endolock.hw.strict import bounded

Slope = Annotated[float, bounded(0.001, 100, "rad/rad")]
"""Bend per handle angle of a setting [rad/rad]; the range is assumed."""
Depth = Annotated[float, bounded(0.001, 10, "m")]
"""Depth of the target of a setting [m]; the range is assumed."""
BEND_PER_HANDLE = 0.97
"""Bend per handle angle in the middle of the hysteresis [rad/rad]. Assumed: the slope of the
default instrument; `endolock hysteresis` measures it."""
LAG_S = 0.025
"""Lag of servo and tip [s]. Assumed: 25 and 2 ms measured on the default instrument."""
HOLD_S = 0.030
"""Dead time in addition to the video's [s]: half a frame at 25 Hz, because the error is constant
between frames, and half a control period of 20 ms."""
COMMAND_DELAY_S = 0.030
"""Delay from a tick to the effect of its command [s]: one and a half control periods of 20 ms."""


@dataclass(frozen=True, kw_only=True)
class Process:
    """Gain, lag and dead time of one axis."""

    gain: float
    """K, error per handle angle [rad/rad], > 0."""
    lag_s: float = LAG_S
    """T [s], >= 0."""
    dead_s: float = 0.4 + HOLD_S
    """L [s], > 0."""

    def __post_init__(self) -> None:
        if not (0 < self.gain < float("inf") and 0 <= self.lag_s < 60 and 0 < self.dead_s < 60):
            raise ConfigError(
                f"process with gain {self.gain:g}, lag {self.lag_s:g} s, dead time "
                f"{self.dead_s:g} s",
                "use a gain and a dead time above 0 and a lag of 0 or more",
            )


def image_gain(
    geometry: SectionGeometry, distance_m: float, bend_per_handle: float = BEND_PER_HANDLE
) -> float:
    """Error per handle angle with a straight section, K [rad/rad].

    K = (bend per handle) (1 + (L/2 + l)/d): the tip rotates and also moves sideways.

    Args:
        geometry: lengths L and l of section and rigid tip.
        distance_m: depth d of the target [m].
        bend_per_handle: slope of the transmission [rad/rad].
    """
    lever = geometry.bending_length_m / 2 + geometry.rigid_tip_m
    return bend_per_handle * (1 + lever / distance_m)


def simc(process: Process, closed_loop_s: float | None = None) -> tuple[float, float]:
    """PI gains by the SIMC rules.

    kp = T / (K (tc + L)), kp/ki = min(T, 4 (tc + L)).

    Args:
        process: the controlled process.
        closed_loop_s: tc, the desired time constant [s]; the dead time if None.

    Returns:
        kp [rad/rad] and ki [1/s].
    """
    reach = (process.dead_s if closed_loop_s is None else closed_loop_s) + process.dead_s
    kp = process.lag_s / (process.gain * reach)
    slow = min(process.lag_s, 4 * reach)
    return kp, kp / slow if slow else 1 / (process.gain * reach)
