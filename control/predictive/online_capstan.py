"""Identification of the capstan model while the lock runs: damped least squares, a slice per tick.

The criterion is that of control/predictive/online_plays.py: the target's offset from the axis in a
frame, d_k, plus the model's bend b at the exposure must be a smooth path of the target,

    min |(1 - Q Q')(b(t_k + shift; p) + R(alpha) d_k)|^2 / s^2 + |(p - p0) / width|^2,

where p are the capstan exponent of the conduit, friction of the section, stiffness and slack of
the cables (control/transmission/quasi_static.py), the delay of the video and its rotation alpha
about the optical axis. Simulating the window once takes some ten milliseconds, so only a few
samples are simulated per tick. A step needs one simulation per cable parameter, and one more to
check that the residual falls.

Reference:
    J. J. More, The Levenberg-Marquardt algorithm: implementation and theory, 1978.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, log, sin

import numpy as np

from endolock.control.predictive.capstan_rollout import CapstanParameters, CapstanRollout
from endolock.control.predictive.online_plays import KNOT_S, splines
from endolock.control.transmission.kinematics import Pair
from endolock.control.transmission.simulation import thin
from endolock.hw.api import Vector

CABLE = 5
"""Number of parameters that describe the cable, the first ones; the others need no simulation of
their own."""
START = CapstanParameters(
    conduit_exponent=0.5,
    section_friction=0.15,
    log_stiffness=log(8e4),
    slack_m=-2e-3,
    handle_gain=1.0,
    video_turn_rad=0.0,
    shift_s=0.0,
)
"""p0, the starting point. Assumed: a common endoscope."""
WIDTH = CapstanParameters(
    conduit_exponent=0.3,
    section_friction=0.1,
    log_stiffness=0.3,
    slack_m=2e-3,
    handle_gain=0.15,
    video_turn_rad=0.1,
    shift_s=0.1,
)
"""Standard deviations of the prior. Assumed, as `START`."""
CHANGED_WIDTH = CapstanParameters(
    conduit_exponent=0.1,
    section_friction=0.02,
    log_stiffness=0.02,
    slack_m=5e-5,
    handle_gain=0.01,
    video_turn_rad=0.01,
    shift_s=0.04,
)
"""The same after a change of the transmission, about what was found before it. Assumed: friction,
the shaft's bend and the latency may change; wires and handles stay as they are."""
CHANGED_FRICTION = 0.7
"""Relative standard deviation of both frictions together after a change [1]. Assumed."""
LOW = CapstanParameters(
    conduit_exponent=0.02,
    section_friction=0.0,
    log_stiffness=log(4e4),
    slack_m=-0.02,
    handle_gain=0.5,
    video_turn_rad=-0.3,
    shift_s=-0.3,
)
HIGH = CapstanParameters(
    conduit_exponent=2.0,
    section_friction=0.6,
    log_stiffness=log(2e5),
    slack_m=0.005,
    handle_gain=1.6,
    video_turn_rad=0.3,
    shift_s=0.3,
)
"""Bounds of the search."""
DELTA = CapstanParameters(
    conduit_exponent=0.02,
    section_friction=0.02,
    log_stiffness=0.05,
    slack_m=1e-4,
    handle_gain=0.02,
    video_turn_rad=1e-3,
    shift_s=2e-3,
)
"""Steps for the derivatives."""
ERROR_RAD = 0.02
"""s, assumed error of the model [rad]: 7.5 px at 12 cm, although it is about one pixel, because the
errors of neighbouring frames are correlated. Source: tuned on the default instrument."""
FEW_KNOTS = 2.0
"""Number of knots below which a slow path is straight [1]: a spline would take up all motion."""
STEP_RAD, MAX_STEPS = 0.02, 350
"""Handle travel between simulated samples [rad], longer if there would be more than this number."""
SAMPLES, SETTLED_SAMPLES = 16, 4
"""Samples simulated per tick [1], 50 us each: until a step hardly lowers the cost, and then."""
SETTLED = 0.9
"""Ratio of costs above which a step hardly lowers them [1]. Assumed."""
LARGE_RAD = 10.0
"""Initial value of the misfit [rad]."""
MOST_DAMPING = 1e6
"""Largest damping [1]."""
GROW, SHRINK = 8.0, 0.3
"""Factors on the damping after a step that raises and one that lowers the cost."""

Stored = tuple[float, tuple[list[float], list[float]]]
"""A time [s] and the states of both axes then."""


@dataclass
class Window:
    """Data of one step."""

    ticks: list[float]
    """Times of the ticks [s]."""
    path: list[float]
    """Cumulative travel of both handles at the ticks, strictly rising [rad]."""
    kept: list[int]
    """Indices of the ticks that are simulated."""
    course: list[Pair]
    """Handle angles at these ticks [rad]."""
    frames: list[tuple[float, float, float]]
    """Believed exposure times [s] and offsets of the target from the axis [rad]."""
    states: tuple[list[float], list[float]]
    """States of the axes before the first tick; empty at rest."""
    knot_s: float
    """Spacing of the knots of the slow path [s]."""
    stored: list[Stored] = field(default_factory=list)
    """Times and states of the simulation with the step, on the way [s]."""
    rollouts: list[CapstanRollout] = field(default_factory=list)
    """Simulations with the best parameters, with each of them changed, and with the step."""

    def bends(self, rollout: CapstanRollout, times: Vector) -> Vector:
        """Bends of a simulation at any times, n x 2 [rad]."""
        travel = np.interp(times, self.ticks, self.path)
        at = [self.path[n] for n in self.kept]
        return np.column_stack(
            [np.interp(travel, at, column) for column in zip(*rollout.bends, strict=True)]
        )


@dataclass
class Search:
    """State of the search."""

    parameters: CapstanParameters = START
    """Best parameters so far."""
    prior: CapstanParameters = START
    """p0."""
    root: Vector = field(default_factory=lambda: np.diag(WIDTH))
    """A root of the covariance of the prior: p = p0 + root u with u of unit variance, 7 x 7."""
    damping: float = 0.3
    """Levenberg-Marquardt damping [1]."""
    misfit_rad: float = LARGE_RAD
    """Residual of the best parameters, rms of both axes together [rad]."""
    settled: bool = False
    """Whether the last step hardly lowered the cost."""
    steps: int = 0
    """Number of steps that lowered the cost."""
    window: Window | None = None
    """Data of the step in progress; None between steps."""


def after_change(found: CapstanParameters) -> Search:
    """Search that begins from what was found before a change of the transmission."""
    both = np.zeros(len(found))
    both[:2] = CHANGED_FRICTION * np.array(found[:2])  # friction, of conduit and section alike
    covariance = np.diag(np.square(CHANGED_WIDTH)) + np.outer(both, both)
    root: Vector = np.linalg.cholesky(covariance).astype(float)
    return Search(found, prior=found, root=root)


def begin(
    search: Search,
    times: Vector,
    handles: Vector,
    frames: list[tuple[float, float, float]],
    states: tuple[list[float], list[float]],
    knot_s: float = KNOT_S,
) -> None:
    """Set up a step.

    Args:
        search: continues from its best parameters.
        times: times of the ticks in the window, m [s].
        handles: handle angles at the ticks, m x 2 [rad].
        frames: believed exposure times [s] and offsets of the target [rad].
        states: states of the axes before the first tick; empty at rest.
        knot_s: spacing of the knots of the slow path [s].
    """
    travel = np.abs(np.diff(handles, axis=0, prepend=handles[:1])).sum(axis=1)
    path = np.cumsum(travel + 1e-9)
    step = max(STEP_RAD, float(path[-1]) / MAX_STEPS)
    kept = sorted({*thin(handles[:, 0], step), *thin(handles[:, 1], step), len(times) - 1})
    course = [(float(up), float(right)) for up, right in handles[kept]]
    window = Window(times.tolist(), path.tolist(), kept, course, frames, states, knot_s)
    for parameters in (search.parameters, *_neighbours(search.parameters)[:CABLE]):
        window.rollouts.append(CapstanRollout(parameters, states))
    search.window = window


def work(search: Search) -> CapstanRollout | None:
    """Simulate one slice of the window; return the simulation of a better model, once found."""
    window = search.window
    assert window is not None
    samples = SETTLED_SAMPLES if search.settled else SAMPLES
    for n, rollout in enumerate(window.rollouts):
        if rollout.advance(window.course, samples):
            if n > CABLE:
                tick = window.kept[len(rollout.bends) - 1]
                window.stored.append((window.ticks[tick], rollout.states))
            return None
    basis = _slow(np.array([frame[0] for frame in window.frames]), window.knot_s)
    residual = _residual(search.parameters, window, window.rollouts[0], basis)
    if len(window.rollouts) == CABLE + 1:
        stepped = _step(search, window, residual, basis)
        window.rollouts.append(CapstanRollout(stepped, window.states))
        return None
    rollout = window.rollouts[-1]
    new_residual = _residual(rollout.parameters, window, rollout, basis)
    old = _cost(search, search.parameters, residual)
    new = _cost(search, rollout.parameters, new_residual)
    better = new < old
    if better or search.damping > 1:
        search.settled = new > SETTLED * old
    search.window = None
    search.damping = min(search.damping * (SHRINK if better else GROW), MOST_DAMPING)
    search.misfit_rad = _misfit_rad(new_residual if better else residual)
    if not better:
        return None
    search.parameters = rollout.parameters
    search.steps += 1
    return rollout


def _neighbours(parameters: CapstanParameters) -> list[CapstanParameters]:
    """The same parameters with one of them changed, each in turn."""
    return [
        CapstanParameters(*(v + (DELTA[k] if k == n else 0.0) for k, v in enumerate(parameters)))
        for n in range(len(parameters))
    ]


def _slow(times: Vector, knot_s: float) -> Vector:
    """Orthonormal basis of slow paths: splines, but constant or straight with few knots."""
    span = float(times[-1] - times[0])
    if span < FEW_KNOTS * knot_s:
        columns = np.column_stack([np.ones(len(times)), times - times[0]])
        columns = columns[:, : 1 if span < knot_s else 2]
    else:
        columns = splines(times, knot_s)
    basis: Vector = np.linalg.qr(columns)[0]
    return basis


def _residual(
    parameters: CapstanParameters, window: Window, rollout: CapstanRollout, basis: Vector
) -> Vector:
    """Part of the target's path by a model that is not smooth, 2 n [rad]."""
    t, *off = np.array(window.frames).T
    bends = window.bends(rollout, t + parameters.shift_s)
    c, s = cos(parameters.video_turn_rad), sin(parameters.video_turn_rad)
    course = bends + np.column_stack([c * off[0] - s * off[1], s * off[0] + c * off[1]])
    residual: Vector = (course - basis @ (basis.T @ course)).ravel()
    return residual


def _step(search: Search, window: Window, residual: Vector, basis: Vector) -> CapstanParameters:
    """Return the parameters after a damped step."""
    values, root = np.array(search.parameters), search.root
    columns = []
    for n, changed in enumerate(_neighbours(search.parameters)):
        rollout = window.rollouts[1 + n if n < CABLE else 0]
        columns.append((_residual(changed, window, rollout, basis) - residual) / DELTA[n])
    # in units of the standard deviations, so that one damping suits all parameters
    jacobian = np.column_stack(columns) @ root / ERROR_RAD
    hessian = jacobian.T @ jacobian + np.eye(len(values))
    gradient = jacobian.T @ (residual / ERROR_RAD) + _away(search, search.parameters)
    damped = hessian + search.damping * np.diag(np.diag(hessian))
    moved = values - root @ np.linalg.solve(damped, gradient)
    return CapstanParameters(*np.clip(moved, LOW, HIGH).tolist())


def _cost(search: Search, parameters: CapstanParameters, residual: Vector) -> float:
    away = _away(search, parameters)
    return float((residual**2).sum() / ERROR_RAD**2 + away @ away)


def _away(search: Search, parameters: CapstanParameters) -> Vector:
    """Distance from the prior, in standard deviations."""
    off = np.array(parameters) - np.array(search.prior)
    return np.array(np.linalg.solve(search.root, off))


def _misfit_rad(residual: Vector) -> float:
    """Root of the mean square of both axes together [rad]."""
    return float(np.sqrt(2 * np.mean(residual**2)))
