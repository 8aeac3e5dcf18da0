"""Fits the transmission of one axis to a slow log of handle angles and bends.

The model is control/quasi_static.py with the geometry held constant. Fitted are mu Theta, mu_b,
k/K, the signed slack, the sheath's friction over K, and, as a nuisance, the zeros of handle and
tip; with tensions also K. The first two thirds of the log are fitted, the last third is predicted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, inf, log, radians

import numpy as np
from scipy.optimize import OptimizeResult, least_squares, minimize

from endolock.control.quasi_static import Cable, Geometry, simulate
from endolock.hw.api import Vector

STEP_RAD = 0.018
"""Handle travel between the samples that are kept [rad]; turning points are kept besides."""
BEND_SCALE_RAD = radians(0.1)
"""A bend is trusted as far as this [rad], where tensions have to be weighed against it."""
TENSION_SCALE = 0.02
"""The same of a tension, as a share of the largest one."""
MODEL_ERROR_RAD = radians(0.02)
"""Deviation of a twin in slow motion from this model, rms [rad]. What the fit leaves beyond the
noise counts instead where that is more. It does not average out, so it is added to the uncertainty
of every parameter as if it all pointed that parameter's way."""
DETERMINED = 0.05
"""Largest uncertainty of a parameter that is called determined, of its value: so that two of them
are 10 %."""
STARTS_M = (-2e-3, 5e-4)
"""Slack to start from [m]: tight wires, and slack ones."""


@dataclass(frozen=True)
class Log:
    """What was recorded, at common times.

    Args:
        t: times [s], m.
        handle: handle angles (up_down, left_right) [rad], m x 2.
        bend: bends (up_down, left_right) [rad], m x 2.
        tension: tensions of the wires up, right, down, left at the handle [N], m x 4, or None.
    """

    t: Vector
    handle: Vector
    bend: Vector
    tension: Vector | None = None

    @property
    def axis(self) -> int:
        """The axis that was moved: that with the larger range of handle angles."""
        return int(np.ptp(self.handle, axis=0).argmax())


@dataclass(frozen=True)
class Parameter:
    """One fitted number.

    Args:
        value: in SI units.
        std: its uncertainty, one standard deviation.
        determined: whether the log tells it to 10 % with two standard deviations.
    """

    value: float
    std: float
    determined: bool


@dataclass(frozen=True, kw_only=True)
class Fit:
    """What a log told."""

    cable: Cable
    bending_stiffness: float | None
    """K [N m/rad]; None without tensions."""
    params: dict[str, Parameter]
    noise_rad: float
    """Of the measured bends, from row to row."""
    fit_rms_rad: float
    """What the fit leaves; much more than the noise where the plant is of another kind."""
    heldout_rms_rad: float
    """Of the bends in the last third, which the fit has not seen."""
    play_heldout_rms_rad: float
    """The same of the best play of constant width, the usual model of a hysteresis."""
    samples: int
    """Kept of the log."""


def fit(log_: Log, geometry: Geometry) -> Fit:
    """Fit the transmission of the axis that was moved.

    Args:
        log_: a slow log of at least two turns, starting with wires at rest.
        geometry: held constant.
    """
    axis, other = log_.axis, 1 - log_.axis
    kept = thin(log_.handle[:, axis], STEP_RAD)
    handle, bend = log_.handle[kept, axis], log_.bend[kept, axis]
    beside = log_.handle[kept, other], log_.bend[kept, other]
    learned = int(np.searchsorted(log_.t[kept], log_.t[0] + 2 / 3 * np.ptp(log_.t)))
    wires = None if log_.tension is None else log_.tension[kept][:, [axis, axis + 2]]
    trust = TENSION_SCALE * float(wires.max()) if wires is not None else inf

    def predict(x: Vector, rows: slice) -> tuple[Vector, Vector]:
        bends, tensions = simulate(
            _cable(x), geometry, handle[rows] - x[5], *(column[rows] for column in beside)
        )
        return bends + x[6], tensions

    def residual(x: Vector) -> Vector:
        bends, tensions = predict(x, slice(learned))
        off = (bends - bend[:learned]) / BEND_SCALE_RAD
        if wires is None:
            return off
        return np.append(off, ((exp(x[7]) * tensions - wires[:learned]) / trust).ravel())

    best = min((_search(residual, slack, wires is not None) for slack in STARTS_M), key=_cost)
    off = predict(best.x, slice(None))[0] - bend
    noise = _noise(log_.bend[:, axis])
    excess = np.sqrt(max(_rms(off[:learned]) ** 2 - noise**2, MODEL_ERROR_RAD**2))
    return Fit(
        cable=_cable(best.x),
        bending_stiffness=exp(best.x[7]) if wires is not None else None,
        params=_parameters(best, excess),
        noise_rad=noise,
        fit_rms_rad=_rms(off[:learned]),
        heldout_rms_rad=_rms(off[learned:]),
        play_heldout_rms_rad=_play(handle, bend, learned),
        samples=len(kept),
    )


def thin(handle: Vector, step_rad: float) -> list[int]:
    """Choose samples a step of handle travel apart, and those where the handle turns.

    Args:
        handle: handle angles [rad], m.
        step_rad: travel between two of them [rad]; smaller turns than a quarter are noise.
    """
    kept, farthest = [0], 0
    for k, angle in enumerate(handle):
        last = handle[kept[-1]]
        if abs(handle[farthest] - angle) >= step_rad / 4 and farthest > kept[-1]:
            ahead = abs(angle - last) > abs(handle[farthest] - last)
            if not ahead:
                kept.append(farthest)
                last = handle[farthest]
        if abs(angle - last) >= step_rad:
            kept.append(k)
        if abs(angle - handle[kept[-1]]) >= abs(handle[farthest] - handle[kept[-1]]):
            farthest = k
        farthest = max(farthest, kept[-1])
    return kept


def _cable(x: Vector) -> Cable:
    return Cable(
        wrap_friction=float(x[0]),
        section_friction=float(x[1]),
        stiffness=exp(x[2]),
        slack_m=float(x[3]),
        sheath=float(x[4]),
    )


def _search(residual: Callable[[Vector], Vector], slack_m: float, tensions: bool) -> OptimizeResult:
    """Least squares from one start; k/K and K by their logarithms."""
    start = [0.5, 0.15, log(8e4), slack_m, 0.01, 0.0, 0.0, log(0.05)]
    scale = [0.3, 0.1, 0.3, 1e-3, 0.03, 0.02, 0.01, 0.3]
    low = [1e-3, 0.0, log(2e3), -0.03, 0.0, -0.3, -0.2, log(1e-4)]
    high = [4.0, 3.0, log(5e6), 0.02, 0.6, 0.3, 0.2, log(1e2)]
    n = 8 if tensions else 7
    return least_squares(
        residual,
        start[:n],
        x_scale=scale[:n],
        bounds=(low[:n], high[:n]),
        diff_step=1e-3,
        max_nfev=40,
    )


def _cost(found: OptimizeResult) -> float:
    return float(found.cost)


def _noise(bend: Vector) -> float:
    """Noise of single rows, from second differences; the median passes turns over."""
    return float(1.4826 * np.median(np.abs(np.diff(bend, 2))) / np.sqrt(6))


def _parameters(found: OptimizeResult, model_rad: float) -> dict[str, Parameter]:
    """Values and uncertainties, from the curvature at the minimum.

    Neighbouring residuals are alike where the model is wrong: with correlation rho the noise counts
    (1 + rho)/(1 - rho) times.
    """
    x, off = found.x, found.fun
    rho = max(0.0, float(np.corrcoef(off[1:], off[:-1])[0, 1]))
    spread = np.linalg.pinv(found.jac.T @ found.jac)
    noise = float(np.mean(off**2)) * (1 + rho) / (1 - rho)
    model = len(off) * (model_rad / BEND_SCALE_RAD) ** 2
    covariance = spread * (noise + model)

    def parameter(value: float, gradient: dict[int, float]) -> Parameter:
        g = np.zeros(len(x))
        g[list(gradient)] = list(gradient.values())
        std = float(np.sqrt(g @ covariance @ g))
        return Parameter(value, std, 0 < std <= DETERMINED * abs(value))

    k, slack = exp(x[2]), float(x[3])
    loose, tight = max(0.0, slack), max(0.0, -slack)
    told = {
        "mu_wrap": parameter(float(x[0]), {0: 1.0}),
        "mu_section": parameter(float(x[1]), {1: 1.0}),
        "k_over_K": parameter(k, {2: k}),
        "slack_m": parameter(loose, {3: 1.0}),
        "pretension_over_K": parameter(tight * k, {2: tight * k, 3: -k}),
        "sheath_over_K": parameter(float(x[4]), {4: 1.0}),
    }
    if len(x) > 7:
        stiff = exp(x[7])
        told["bending_stiffness"] = parameter(stiff, {7: stiff})
        told["wire_stiffness"] = parameter(k * stiff, {2: k * stiff, 7: k * stiff})
        pull = tight * k * stiff
        told["pretension_n"] = parameter(pull, {2: pull, 3: -k * stiff, 7: pull})
    return told


def _play(handle: Vector, bend: Vector, learned: int) -> float:
    """Held-out error of the best play operator with gain and zero [rad]."""

    def predict(x: Vector) -> Vector:
        gain, width, zero = x
        at, out = 0.0, []
        for angle in handle.tolist():
            at = min(max(at, angle - width / 2), angle + width / 2)
            out.append(gain * at + zero)
        return np.array(out)

    def cost(x: Vector) -> float:
        return _rms((predict(x) - bend)[:learned])

    gain = np.ptp(bend) / np.ptp(handle)
    best = minimize(cost, [gain, 0.3, 0.0], method="Nelder-Mead")
    return _rms((predict(best.x) - bend)[learned:])


def _rms(values: Vector) -> float:
    return float(np.sqrt(np.mean(values**2)))
