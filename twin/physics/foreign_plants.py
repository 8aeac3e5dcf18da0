"""Transmissions of other kinds, to test controllers and fits on plants that they do not model.

All but the sum of plays are unlike the twin's wires in one respect each: a gap without friction, a
gap before friction, gradual sliding, a tip that gives way with time. Both axes are alike and
independent. Bends are about as large as the twin's, and its lost motion of 0.2 of 180 deg is of the
same size as theirs; all numbers are assumed. None of the bends turns against its handle.

    axes = DeadZone().at_rest()
    axes.follow((0.2, 0.5))  # up_down within the gap, left_right beyond it
    -> (0.0, 0.2716)

Reference:
    Y. K. Wen, J. Engineering Mechanics 102(2), 1976; P. Krejci and K. Kuhnen, IEE Proc. Control
    Theory and Applications 148(3), 2001.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, pi, radians, sin
from typing import Protocol

from endolock.control.transmission.kinematics import Pair
from endolock.control.transmission.linear_process import BEND_PER_HANDLE
from endolock.control.transmission.plays import Plays, play_step
from endolock.twin.physics.surrogate_plant import TIMESTEP_S


class OneAxis(Protocol):
    """One axis with its history."""

    friction_times: float
    """Friction over that at rest [1]."""

    def follow(self, handle_rad: float) -> float:
        """Move the handle to an angle [rad]; return the bend [rad]."""


class EqualAxes:
    """Both axes, alike and independent.

    Args:
        make: returns one axis at rest.
    """

    def __init__(self, make: Callable[[], OneAxis]) -> None:
        self._axes = make(), make()

    def follow(self, handles: Pair) -> Pair:
        """Move the handles to angles [rad]; return the bends [rad]."""
        up_down, left_right = self._axes
        return up_down.follow(handles[0]), left_right.follow(handles[1])

    def rub(self, times: float) -> None:
        """Set the friction to a multiple of that at rest [1]."""
        for axis in self._axes:
            axis.friction_times = times


@dataclass(frozen=True, kw_only=True)
class DeadZone:
    """Slack at rest without friction: bend = k (h - clip(h, -s, s)). It has no history."""

    half_width_rad: float = 0.22
    """s, handle angle that does nothing on either side of rest [rad]. Assumed."""
    bend_per_handle: float = BEND_PER_HANDLE
    """k, beyond it [rad/rad]."""

    def at_rest(self) -> DeadZone:
        """Return both axes; their state is always the same."""
        return self

    def follow(self, handles: Pair) -> Pair:
        """Move the handles to angles [rad]; return the bends [rad]."""
        up_down, left_right = (_beyond(handle, self.half_width_rad) for handle in handles)
        return self.bend_per_handle * up_down, self.bend_per_handle * left_right


@dataclass(frozen=True, kw_only=True)
class PlayBehindDeadZone:
    """Slack at rest, and behind it dry friction: a play of what the slack lets through."""

    slack_rad: float = 0.12
    """Handle angle that does nothing on either side of rest [rad]. Assumed."""
    half_width_rad: float = 0.18
    """Half-width of the play [rad]. Assumed."""
    bend_per_handle: float = BEND_PER_HANDLE
    """Bend per handle angle [rad/rad]."""

    def at_rest(self) -> EqualAxes:
        """Return both axes with the plays centred."""
        return EqualAxes(lambda: _PlayAxis(self))


class _PlayAxis:
    """State of one axis of `PlayBehindDeadZone`."""

    def __init__(self, made: PlayBehindDeadZone) -> None:
        self._made, self._output_rad, self.friction_times = made, 0.0, 1.0

    def follow(self, handle_rad: float) -> float:
        made = self._made
        pulled = _beyond(handle_rad, made.slack_rad)
        half_width = self.friction_times * made.half_width_rad
        self._output_rad = play_step(self._output_rad, pulled, half_width)
        return made.bend_per_handle * self._output_rad


@dataclass(frozen=True, kw_only=True)
class BoucWen:
    """Gradual sliding: bend = k (h - l), where the lost motion l follows the handle.

        dl = c (1 - |l|/w) dh   away from rest, l dh > 0
        dl = c dh               back to it

    which is the law of Bouc and Wen with beta = gamma, n = 1. It is solved exactly for each step,
    so that it depends on the path alone, however that is divided.
    """

    half_width_rad: float = 0.3
    """w, lost motion of long strokes [rad]. Assumed."""
    lost_share: float = 0.95
    """c, share of the handle's motion that is lost after a reversal [1], 0 to 1. Assumed."""
    bend_per_handle: float = BEND_PER_HANDLE
    """k, of long strokes [rad/rad]."""

    def at_rest(self) -> EqualAxes:
        """Return both axes without lost motion."""
        return EqualAxes(lambda: _BoucWenAxis(self))


class _BoucWenAxis:
    """State of one axis of `BoucWen`."""

    def __init__(self, made: BoucWen) -> None:
        self._made, self.friction_times = made, 1.0
        self._handle_rad = self._lost_rad = 0.0

    def follow(self, handle_rad: float) -> float:
        made, by = self._made, handle_rad - self._handle_rad
        sign = 1.0 if by > 0 else -1.0
        self._handle_rad = handle_rad
        lost, by = sign * self._lost_rad, abs(by)
        if lost < 0:
            back = min(by, -lost / made.lost_share)
            lost, by = lost + made.lost_share * back, by - back
        width = self.friction_times * made.half_width_rad
        lost = width - (width - lost) * exp(-made.lost_share * by / width) if width else 0.0
        self._lost_rad = sign * lost
        return made.bend_per_handle * (handle_rad - self._lost_rad)


@dataclass(frozen=True, kw_only=True)
class CreepAndDrift:
    """A play whose bend gives way with time, and whose zero drifts.

    With z the output of the play, bend = k (z - c) + d sin(2 pi t / T), where the creep c tends to
    a share of z, tau c' = a z - c. Time goes on by `TIMESTEP_S` with each call of `follow`.
    """

    half_width_rad: float = 0.24
    """Half-width of the play [rad]. Assumed."""
    creep_share: float = 0.1
    """a, share of a held bend that is lost in the end [1]. Assumed."""
    creep_time_s: float = 10.0
    """tau [s]. Assumed."""
    drift_rad: float = radians(2.0)
    """d, largest drift of the zero [rad]. Assumed."""
    drift_period_s: float = 480.0
    """T [s]. Assumed: at its fastest 1.6 deg per minute."""
    bend_per_handle: float = BEND_PER_HANDLE
    """k, before the creep [rad/rad]."""

    def at_rest(self) -> EqualAxes:
        """Return both axes with the plays centred, without creep, at the start of the drift."""
        return EqualAxes(lambda: _CreepingAxis(self))


class _CreepingAxis:
    """State of one axis of `CreepAndDrift`."""

    def __init__(self, made: CreepAndDrift) -> None:
        self._made, self.friction_times = made, 1.0
        self._keep = exp(-TIMESTEP_S / made.creep_time_s)
        self._output_rad = self._creep_rad = self._t = 0.0

    def follow(self, handle_rad: float) -> float:
        made = self._made
        half_width = self.friction_times * made.half_width_rad
        self._output_rad = play_step(self._output_rad, handle_rad, half_width)
        end = made.creep_share * self._output_rad
        self._creep_rad = end + (self._creep_rad - end) * self._keep
        self._t += TIMESTEP_S
        drift = made.drift_rad * sin(2 * pi * self._t / made.drift_period_s)
        return made.bend_per_handle * (self._output_rad - self._creep_rad) + drift


SUM_OF_PLAYS = Plays(radii=(0.0, 0.1, 0.25, 0.45), weights=(0.25, 0.15, 0.2, 0.1))
"""Plays of several widths, after Prandtl and Ishlinskii; unlike those of the twin, their loop has
no plateau. Assumed."""


def _beyond(angle_rad: float, half_width_rad: float) -> float:
    """Return by how much an angle is outside a gap around zero [rad]."""
    return angle_rad - min(max(angle_rad, -half_width_rad), half_width_rad)
