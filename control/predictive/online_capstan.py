"""Identification of the capstan model while the lock runs: damped least squares, a slice per tick.

What is fitted to is what control/predictive/online_plays.py fits its weights to: where a frame saw
the target off the axis, d_k, plus the bend b of the model then must be a smooth course of the
target,

    min |(1 - Q Q')(b(t_k + shift; p) + R(alpha) d_k)|^2 / s^2 + |(p - p0) / width|^2,

p being friction along the conduit and in the section, stiffness and slack of both axes' cables
(control/transmission/quasi_static.py), the shift of the video and its turn alpha about the optical
axis. One model of the window takes some ten milliseconds, so it is followed a few samples per tick;
a step needs one for each parameter, and one more to see whether it was a step down.

Reference:
    J. J. More, The Levenberg-Marquardt algorithm: implementation and theory, 1978.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import cos, exp, log, sin
from typing import NamedTuple

import numpy as np

from endolock.control.predictive.online_plays import splines
from endolock.control.transmission.kinematics import Pair
from endolock.control.transmission.quasi_static import Axis, BothAxes, Cable, Geometry, thin
from endolock.hw.api import Vector


class CapstanParameters(NamedTuple):
    """What is searched for, the same cable on both axes."""

    conduit_exponent: float
    """Capstan exponent mu Theta of the conduit [1]."""
    section_friction: float
    """mu_b [1]."""
    log_stiffness: float
    """Logarithm of k/K, k/K in 1/m2."""
    slack_m: float
    """Free length of each wire [m]; negative is pretension."""
    video_turn_rad: float
    """alpha, turn of the video about the optical axis against the bends [rad]."""
    shift_s: float
    """Time by which exposures are later than believed [s]."""


CABLE = 4
"""Number of unknowns that describe the cable, the first ones; the others need no model of their
own."""
START = CapstanParameters(
    conduit_exponent=0.5,
    section_friction=0.15,
    log_stiffness=log(8e4),
    slack_m=-2e-3,
    video_turn_rad=0.0,
    shift_s=0.0,
)
"""p0, where the search begins. Assumed: a common endoscope."""
WIDTH = CapstanParameters(
    conduit_exponent=0.3,
    section_friction=0.1,
    log_stiffness=0.3,
    slack_m=2e-3,
    video_turn_rad=0.1,
    shift_s=0.1,
)
"""Standard deviations of the prior. Assumed, as `START`."""
LOW = CapstanParameters(
    conduit_exponent=0.02,
    section_friction=0.0,
    log_stiffness=log(4e4),
    slack_m=-0.02,
    video_turn_rad=-0.3,
    shift_s=-0.3,
)
HIGH = CapstanParameters(
    conduit_exponent=2.0,
    section_friction=0.6,
    log_stiffness=log(2e5),
    slack_m=0.005,
    video_turn_rad=0.3,
    shift_s=0.3,
)
"""Bounds of the search."""
DELTA = CapstanParameters(
    conduit_exponent=0.02,
    section_friction=0.02,
    log_stiffness=0.05,
    slack_m=1e-4,
    video_turn_rad=1e-3,
    shift_s=2e-3,
)
"""Steps for the derivatives."""
ERROR_RAD = 0.02
"""s, what the model may be off [rad]: five pixels, though it is off by one, because neighbouring
frames err alike. Source: tuned on the default instrument."""
SHEATH = 0.01
"""Dry friction of the sheath over K [rad]: hardly ever told by a log (docs/identify.md)."""
STEP_RAD, MOST = 0.02, 350
"""The handles' course is followed in steps of that travel, or in so many."""
SAMPLES = 8
"""Followed in one tick: half a millisecond."""
LARGE_RAD = 10.0
"""A misfit before there is one [rad]."""
GROW, SHRINK = 8.0, 0.3
"""Factors on the damping after a step up and a step down."""


@dataclass
class Track:
    """A model on its way along a course of handle angles."""

    values: CapstanParameters
    """Its parameters."""
    states: tuple[list[float], list[float]]
    """Of the two axes; empty at rest."""
    bends: list[tuple[float, float]] = field(default_factory=list)
    """After each sample so far [rad]."""

    def follow(self, course: Sequence[Pair], most: int) -> int:
        """Go on by at most so many samples of a course; return how many they were."""
        ahead = course[len(self.bends) : len(self.bends) + most]
        self.go_on(ahead)
        return len(ahead)

    def go_on(self, course: Sequence[Pair]) -> None:
        """Turn the handles on."""
        if not course:
            return
        one, other = made(self.values, self.states)
        both = BothAxes(one, other)
        self.bends += [both.follow(handles) for handles in course]
        self.states = one.state, other.state


@dataclass
class Window:
    """What a step is made from."""

    ticks: list[float]
    """Times [s]."""
    path: list[float]
    """Travel of the handles up to then, always growing [rad]."""
    kept: list[int]
    """Which of them are followed."""
    course: list[Pair]
    """Handle angles at those [rad]."""
    frames: list[tuple[float, float, float]]
    """Exposures as believed [s], and how far the target was off then [rad]."""
    states: tuple[list[float], list[float]]
    """Of the axes before the first tick; empty at rest."""
    tracks: list[Track] = field(default_factory=list)
    """Of the best values, of each changed a little, and of the step."""

    def bends(self, track: Track, times: Vector) -> Vector:
        """Bends of a model at any times, n x 2 [rad]."""
        way = np.interp(times, self.ticks, self.path)
        at = [self.path[n] for n in self.kept]
        return np.column_stack(
            [np.interp(way, at, column) for column in zip(*track.bends, strict=True)]
        )


@dataclass
class Search:
    """Where the search stands."""

    values: CapstanParameters = START
    """The best so far."""
    spread: CapstanParameters = WIDTH
    """Their standard deviations."""
    damping: float = 1.0
    misfit_rad: float = LARGE_RAD
    """What they leave, rms [rad]."""
    steps: int = 0
    """Steps down so far."""
    window: Window | None = None


def made(values: CapstanParameters, states: tuple[list[float], list[float]]) -> tuple[Axis, Axis]:
    """Make both axes, going on from states, or from rest where those are empty."""
    cable = Cable(
        conduit_exponent=values.conduit_exponent,
        section_friction=values.section_friction,
        stiffness=exp(values.log_stiffness),
        slack_m=values.slack_m,
        sheath=SHEATH,
    )
    axes = Axis(cable, Geometry()), Axis(cable, Geometry())
    for axis, state in zip(axes, states, strict=True):
        if state:
            axis.state = state
    return axes


def begin(
    search: Search,
    times: Vector,
    handles: Vector,
    frames: list[tuple[float, float, float]],
    states: tuple[list[float], list[float]],
) -> None:
    """Set up a step.

    Args:
        search: goes on from its best values.
        times: of the ticks in the window, m [s].
        handles: angles then, m x 2 [rad].
        frames: exposures as believed [s] and offsets of the target [rad].
        states: of the axes before the first tick; empty at rest.
    """
    travel = np.abs(np.diff(handles, axis=0, prepend=handles[:1])).sum(axis=1)
    path = np.cumsum(travel + 1e-9)
    step = max(STEP_RAD, float(path[-1]) / MOST)
    kept = sorted({*thin(handles[:, 0], step), *thin(handles[:, 1], step), len(times) - 1})
    course = [(float(a), float(b)) for a, b in handles[kept]]
    window = Window(times.tolist(), path.tolist(), kept, course, frames, states)
    for values in (search.values, *_neighbours(search.values)[:CABLE]):
        window.tracks.append(Track(values, states))
    search.window = window


def work(search: Search) -> Track | None:
    """Follow the window by a slice; return a better model once there is one, at its end."""
    window = search.window
    assert window is not None
    for track in window.tracks:
        if track.follow(window.course, SAMPLES):
            return None
    basis, _ = np.linalg.qr(splines(np.array([frame[0] for frame in window.frames])))
    rest = _residual(search.values, window, window.tracks[0], basis)
    if len(window.tracks) == CABLE + 1:
        window.tracks.append(Track(_step(search, window, rest, basis), window.states))
        return None
    track = window.tracks[-1]
    left = _residual(track.values, window, track, basis)
    better = _cost(track.values, left) < _cost(search.values, rest)
    search.window = None
    search.damping *= SHRINK if better else GROW
    search.misfit_rad = _rms(left if better else rest)
    if not better:
        return None
    search.values = track.values
    search.steps += 1
    return track


def _neighbours(values: CapstanParameters) -> list[CapstanParameters]:
    """The same values with one of them changed, each in turn."""
    return [
        CapstanParameters(*(v + (DELTA[k] if k == n else 0.0) for k, v in enumerate(values)))
        for n in range(len(values))
    ]


def _residual(values: CapstanParameters, window: Window, track: Track, basis: Vector) -> Vector:
    """What is not smooth in the target's course as a model has it, 2 n [rad]."""
    t, *off = np.array(window.frames).T
    bends = window.bends(track, t + values.shift_s)
    c, s = cos(values.video_turn_rad), sin(values.video_turn_rad)
    course = bends + np.column_stack([c * off[0] - s * off[1], s * off[0] + c * off[1]])
    rest: Vector = (course - basis @ (basis.T @ course)).ravel()
    return rest


def _step(search: Search, window: Window, rest: Vector, basis: Vector) -> CapstanParameters:
    """Take a damped step from the derivatives."""
    values, width = np.array(search.values), np.array(WIDTH)
    columns = []
    for n, changed in enumerate(_neighbours(search.values)):
        track = window.tracks[1 + n if n < CABLE else 0]
        columns.append((_residual(changed, window, track, basis) - rest) / DELTA[n])
    # in units of the widths, so that one damping fits all
    jacobian = np.column_stack(columns) * width / ERROR_RAD
    hessian = jacobian.T @ jacobian + np.eye(len(values))
    gradient = jacobian.T @ (rest / ERROR_RAD) + (values - np.array(START)) / width
    damped = hessian + search.damping * np.diag(np.diag(hessian))
    search.spread = CapstanParameters(*(width * np.sqrt(np.diag(np.linalg.inv(hessian)))).tolist())
    moved = values - width * np.linalg.solve(damped, gradient)
    return CapstanParameters(*np.clip(moved, LOW, HIGH).tolist())


def _cost(values: CapstanParameters, rest: Vector) -> float:
    away = (np.array(values) - np.array(START)) / np.array(WIDTH)
    return float((rest**2).sum() / ERROR_RAD**2 + (away**2).sum())


def _rms(rest: Vector) -> float:
    """Of both axes together [rad]."""
    return float(np.sqrt(2 * np.mean(rest**2)))
