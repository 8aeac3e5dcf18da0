"""Prandtl-Ishlinskii hysteresis: a weighted sum of plays, with its exact inverse.

With z_i the output of the play of half-width r_i for the handle angle h, |h - z_i| <= r_i, the bend
is sum w_i z_i. If all w_i >= 0 it rises with h from every state, so each bend has one handle angle.

Reference:
    P. Krejci and K. Kuhnen, IEE Proc. Control Theory and Applications 148(3), 2001.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import pi
from typing import Annotated

import numpy as np

from endolock.control.rms import rms
from endolock.control.transmission.kinematics import Pair
from endolock.control.transmission.linear_process import BEND_PER_HANDLE
from endolock.hw.api import ConfigError, Vector
from endolock.hw.strict import bounded, shown

LARGEST_RADIUS_RAD = 4 * pi
LARGEST_WEIGHT = 100.0
"""Largest half-width [rad] and bend per handle angle [rad/rad] of a play. Assumed."""
MOST_PLAYS = 1000
"""Most plays of an axis [1]. Assumed."""


@dataclass(frozen=True, kw_only=True)
class Plays:
    """Parameters of one axis."""

    radii: tuple[Annotated[float, bounded(0, LARGEST_RADIUS_RAD, "rad")], ...]
    """Half-widths r_i at the handle [rad], 0 to 4 pi, rising."""
    weights: tuple[Annotated[float, bounded(0, LARGEST_WEIGHT, "rad/rad")], ...]
    """Bend per handle angle w_i of each [rad/rad], 0 to 100; their sum is the slope of long
    strokes."""

    def __post_init__(self) -> None:
        radii, weights = self.radii, self.weights
        same = 0 < len(radii) == len(weights) <= MOST_PLAYS
        if not (
            same
            and all(0 <= r <= LARGEST_RADIUS_RAD for r in radii)
            and all(0 <= w <= LARGEST_WEIGHT for w in weights)
            and sum(weights) > 0
        ):
            raise ConfigError(
                f"plays of radii {shown(radii)} and weights {shown(weights)}",
                f"give the same number of each, 1 to {MOST_PLAYS}, radii of 0 to 4 pi rad, weights "
                f"of 0 to {LARGEST_WEIGHT:g} rad/rad, not all 0",
            )

    def at_rest(self) -> PlaysOfBothAxes:
        """Return both axes, equal and independent, with every play centred."""
        return PlaysOfBothAxes(self)


ONE_PLAY = Plays(radii=(pi / 10,), weights=(BEND_PER_HANDLE,))
"""A loop of constant width, 0.2 of 180 deg, as compensated in the thesis (ch. 6)."""


@dataclass
class Hysteresis:
    """Plays of one axis with their state.

    The state `outputs` are plain numbers: restoring them continues from there.
    """

    plays: Plays
    outputs: list[float] = field(default_factory=list)
    """z_i [rad]; all 0 at first."""

    def __post_init__(self) -> None:
        self.outputs = self.outputs or [0.0] * len(self.plays.radii)

    @property
    def bend_rad(self) -> float:
        """Present bend [rad]."""
        return sum(w * z for w, z in zip(self.plays.weights, self.outputs, strict=True))

    def follow(self, handle_rad: float) -> float:
        """Move the handle to an angle; return the bend [rad]."""
        bend = 0.0
        outputs = self.outputs
        for i, (r, w) in enumerate(zip(self.plays.radii, self.plays.weights, strict=True)):
            outputs[i] = play_step(outputs[i], handle_rad, r)
            bend += w * outputs[i]
        return bend

    def handle_for(self, bend_rad: float) -> float:
        """Handle angle that gives a bend from the present state, which stays unchanged [rad].

        For the present bend, which a range of handle angles gives, it is the middle of the range.
        """
        missing = bend_rad - self.bend_rad
        if missing == 0.0:
            return self._middle()
        sign = 1.0 if missing > 0 else -1.0
        missing *= sign
        # Play i starts to move when the handle reaches z_i + r_i (upwards), in this order:
        starts = sorted(
            (sign * z + r, w)
            for z, r, w in zip(self.outputs, self.plays.radii, self.plays.weights, strict=True)
            if w
        )
        at, slope = starts[0][0], 0.0
        for start, weight in starts:
            if slope and missing <= slope * (start - at):
                break
            missing -= slope * (start - at)
            at, slope = start, slope + weight
        return sign * (at + missing / slope)

    def _middle(self) -> float:
        """Middle of the handle angles that change no play [rad]."""
        pairs = list(zip(self.outputs, self.plays.radii, strict=True))
        return (max(z - r for z, r in pairs) + min(z + r for z, r in pairs)) / 2


class PlaysOfBothAxes:
    """Both axes of a section, each with its own plays.

    Args:
        plays: parameters of each.
    """

    def __init__(self, plays: Plays) -> None:
        self._plays = plays
        self._axes = Hysteresis(plays), Hysteresis(plays)

    def follow(self, handles: Pair) -> Pair:
        """Move the handles to angles [rad]; return the bends [rad]."""
        up_down, left_right = self._axes
        return up_down.follow(handles[0]), left_right.follow(handles[1])

    def rub(self, times: float) -> None:
        """Make all loops wider or narrower by a factor on those at rest [1]."""
        radii = tuple(times * r for r in self._plays.radii)
        for axis in self._axes:
            axis.plays = replace(self._plays, radii=radii)


def fit(handle_rad: Vector, bend_rad: Vector, radii: Sequence[float]) -> tuple[Plays, float]:
    """Fit the weights for given radii to a log that starts at rest, by non-negative least squares.

    Args:
        handle_rad: handle angles, n [rad].
        bend_rad: bends at the same times, n [rad].
        radii: half-widths [rad].

    Returns:
        The plays with a weight above 0, and the rms residual [rad].
    """
    from scipy.optimize import nnls  # analysis only

    columns = np.column_stack([play(handle_rad, r) for r in radii])
    weights, _ = nnls(columns, bend_rad)
    misfit = rms(columns @ weights - bend_rad)
    least = 1e-9 * weights.sum()
    kept = [(float(r), float(w)) for r, w in zip(radii, weights, strict=True) if w > least]
    return Plays(radii=tuple(r for r, _ in kept), weights=tuple(w for _, w in kept)), misfit


def play(handle_rad: Vector, radius_rad: float, start_rad: float = 0.0) -> Vector:
    """Output of one play for a history of handle angles [rad].

    Args:
        handle_rad: handle angles, n [rad].
        radius_rad: half-width r [rad], >= 0.
        start_rad: output before the first of them [rad].
    """
    outputs, z = np.empty(len(handle_rad)), start_rad
    for n, handle in enumerate(handle_rad.tolist()):
        z = play_step(z, handle, radius_rad)
        outputs[n] = z
    return outputs


def play_step(output_rad: float, handle_rad: float, radius_rad: float) -> float:
    """Return the next output of a play, clip(z, h - r, h + r) [rad].

    Args:
        output_rad: output z so far [rad].
        handle_rad: next handle angle h [rad].
        radius_rad: half-width r [rad], >= 0.
    """
    return min(max(output_rad, handle_rad - radius_rad), handle_rad + radius_rad)
