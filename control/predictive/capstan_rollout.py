"""Capstan model of both axes for the lock: its parameters, and a simulation that can resume."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import exp
from typing import NamedTuple

from endolock.control.transmission.both_axes import BothAxes
from endolock.control.transmission.kinematics import Pair
from endolock.control.transmission.quasi_static import Axis, Cable, Geometry

SHEATH = 0.01
"""Dry friction of the sheath over K [rad]: a log rarely determines it
(docs/identify.md). Assumed."""


class CapstanParameters(NamedTuple):
    """Parameters of the search; both axes have the same cable."""

    conduit_exponent: float
    """Capstan exponent mu Theta of the conduit [1]."""
    section_friction: float
    """mu_b [1]."""
    log_stiffness: float
    """Logarithm of k/K, k/K in 1/m2."""
    slack_m: float
    """Free length of each wire [m]; negative is pretension."""
    handle_gain: float
    """Handle angles over those of a pulley of the default radius [1]."""
    video_turn_rad: float
    """alpha, rotation of the video about the optical axis relative to the bends [rad]."""
    shift_s: float
    """Delay of the exposures relative to their believed times [s]."""


@dataclass
class CapstanRollout:
    """A capstan model that is being simulated along a sequence of handle angles."""

    parameters: CapstanParameters
    """Parameters of the model."""
    states: tuple[list[float], list[float]]
    """States of the two axes; empty at rest."""
    bends: list[Pair] = field(default_factory=list)
    """Bend after each sample simulated so far [rad]."""
    _axes: tuple[Axis, Axis] | None = None

    @property
    def axes(self) -> tuple[Axis, Axis]:
        """Both axes in their present states."""
        if self._axes is None:
            self._axes = axes_of(self.parameters, self.states)
        return self._axes

    def advance(self, course: Sequence[Pair], maximum: int) -> int:
        """Simulate the next samples of a sequence, at most a maximum number; return how many."""
        ahead = course[len(self.bends) : len(self.bends) + maximum]
        self.follow(ahead)
        return len(ahead)

    def follow(self, handles: Sequence[Pair]) -> None:
        """Move the handles through more angles [rad]."""
        if not handles:
            return
        up_down, left_right = self.axes
        both = BothAxes(up_down, left_right)
        gain = self.parameters.handle_gain
        self.bends += [both.follow((gain * a, gain * b)) for a, b in handles]
        self.states = up_down.state, left_right.state


def axes_of(
    parameters: CapstanParameters, states: tuple[list[float], list[float]]
) -> tuple[Axis, Axis]:
    """Make both axes from their states, or at rest if these are empty."""
    cable = Cable(
        conduit_exponent=parameters.conduit_exponent,
        section_friction=parameters.section_friction,
        stiffness=exp(parameters.log_stiffness),
        slack_m=parameters.slack_m,
        sheath=SHEATH,
    )
    axes = Axis(cable, Geometry()), Axis(cable, Geometry())
    for axis, state in zip(axes, states, strict=True):
        if state:
            axis.state = state
    return axes
