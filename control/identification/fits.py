"""Fits the transmission of one axis to a slow log of handle angles and bends.

The model is control/transmission/quasi_static.py with the geometry held constant. Fitted are mu
Theta, mu_b, k/K, the signed slack, the sheath's friction over K, and, as a nuisance, the zeros of
handle and tip; with tensions also K. The first two thirds of the log are fitted, the last third is
predicted.

The model starts with wires at rest, a log need not: what comes before the first long stroke has
ended is followed but not fitted, because such a stroke makes all wires slide and leaves no memory.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import exp, log, radians

import numpy as np
from scipy.optimize import OptimizeResult, least_squares, minimize

from endolock.control.identification.uncertainty import Parameter, Spread
from endolock.control.transmission.quasi_static import Cable, Geometry, simulate, thin
from endolock.hw.api import Vector

STEP_RAD = 0.018
"""Handle travel between the samples that are kept [rad]; turning points are kept besides."""
BEND_SCALE_RAD = radians(0.1)
"""A bend is trusted as far as this [rad], where tensions have to be weighed against it."""
TENSION_SCALE = 0.02
"""The same of a tension, as a share of the largest one."""
MODEL_ERROR_RAD = radians(0.02)
"""Deviation of a twin in slow motion from this model, rms [rad]. What the fit leaves beyond the
noise counts instead where that is more."""
MISFIT_RAD, MISFIT = radians(0.15), 0.5
"""A fit that leaves more than that and more than so many times the noise, the noise taken off, is
none: the plant works in another way, or the geometry is not its, and nothing is determined."""
LONG_STROKE = 0.45
"""Travel after which all wires slide, of the range of the handle: from the middle to a crest."""
COARSE = 3
"""The first search takes so much longer steps."""
STARTS = (
    Cable(wrap_friction=0.5, section_friction=0.15, stiffness=8e4, slack_m=-2e-3, sheath=0.01),
    Cable(wrap_friction=0.5, section_friction=0.15, stiffness=8e4, slack_m=5e-4, sheath=0.01),
    Cable(wrap_friction=0.15, section_friction=0.02, stiffness=2.5e4, slack_m=-1.5e-2, sheath=0.01),
)
"""Where to search from: tight wires, slack ones, and soft ones under much tension."""
SCALE = (0.3, 0.1, 0.3, 1e-3, 0.03, 0.02, 0.01, 0.3)
LOW = (1e-3, 0.0, log(2e3), -0.03, 0.0, -0.3, -0.2, log(1e-4))
HIGH = (4.0, 3.0, log(5e6), 0.02, 0.6, 0.3, 0.2, log(1e2))
"""Of mu Theta, mu_b, log k/K, slack, sheath/K, the zeros of handle and tip, and log K."""


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
    """What the fit leaves."""
    misfit: bool
    """Whether that is so much more than the noise that the plant must be of another kind."""
    heldout_rms_rad: float
    """Of the bends in the last third, which the fit has not seen."""
    play_heldout_rms_rad: float
    """The same of the best play of constant width, the usual model of a hysteresis."""
    samples: int
    """Kept of the log."""


def fit(log_: Log, geometry: Geometry) -> Fit:
    """Fit the transmission of the axis that was moved.

    Args:
        log_: a slow log of at least two turns.
        geometry: held constant.
    """
    coarse = _residual(_rows(log_, COARSE * STEP_RAD), geometry)
    rows = _rows(log_, STEP_RAD)
    free = len(SCALE) if rows.tension is not None else len(SCALE) - 1
    near = min((_search(coarse, _vector(start)[:free]) for start in STARTS), key=_cost)
    best = _search(_residual(rows, geometry), near.x)

    fitted, held_out = slice(rows.settled, rows.learned), slice(rows.learned, None)
    off = rows.predict(best.x, geometry)[0] - rows.bend
    noise, left = _noise(log_.bend[:, log_.axis]), _rms(off[fitted])
    excess = float(np.sqrt(max(left**2 - noise**2, 0.0)))
    misfit = excess > max(MISFIT_RAD, MISFIT * noise)
    params = _parameters(best, max(excess, MODEL_ERROR_RAD))
    if misfit:
        params = {name: replace(told, determined=False) for name, told in params.items()}
    return Fit(
        cable=_cable(best.x),
        bending_stiffness=exp(best.x[7]) if rows.tension is not None else None,
        params=params,
        noise_rad=noise,
        fit_rms_rad=left,
        misfit=misfit,
        heldout_rms_rad=_rms(off[held_out]),
        play_heldout_rms_rad=_play(rows),
        samples=rows.samples,
    )


@dataclass(frozen=True, kw_only=True)
class _Rows:
    """What is kept of a log, of the axis that was moved and the other one, behind a way there."""

    handle: Vector
    bend: Vector
    other_handle: Vector
    other_bend: Vector
    tension: Vector | None
    settled: int
    learned: int
    """Fitted are the rows from `settled` to here."""
    samples: int
    """Rows that were measured."""

    def predict(
        self, x: Vector, geometry: Geometry, end: int | None = None
    ) -> tuple[Vector, Vector]:
        bends, tensions = simulate(
            _cable(x),
            geometry,
            self.handle[:end] - x[5],
            self.other_handle[:end],
            self.other_bend[:end],
        )
        return bends + x[6], tensions


def _rows(log_: Log, step_rad: float) -> _Rows:
    axis, other = log_.axis, 1 - log_.axis
    kept = thin(log_.handle[:, axis], step_rad)
    start = float(log_.handle[kept[0], axis])
    lead = np.arange(0.0, abs(start), step_rad) * np.sign(start)  # from rest to where it begins
    settled = len(lead) + _first_long_stroke(log_.handle[kept, axis])
    kept = [kept[0]] * len(lead) + kept
    learned = int(np.searchsorted(log_.t[kept], log_.t[0] + 2 / 3 * np.ptp(log_.t)))
    handle = log_.handle[kept, axis]
    handle[: len(lead)] = lead
    return _Rows(
        handle=handle,
        bend=log_.bend[kept, axis],
        other_handle=log_.handle[kept, other],
        other_bend=log_.bend[kept, other],
        tension=None if log_.tension is None else log_.tension[kept][:, [axis, axis + 2]],
        # where strokes grow slowly, so that none is long for a while, they began at rest
        settled=settled if settled < learned / 2 else len(lead),
        learned=learned,
        samples=len(kept) - len(lead),
    )


def _first_long_stroke(handle: Vector) -> int:
    """Return the row where the handle has travelled `LONG_STROKE` of its range in one direction."""
    up = handle - np.minimum.accumulate(handle)
    down = np.maximum.accumulate(handle) - handle
    return int(np.argmax(np.maximum(up, down) >= LONG_STROKE * np.ptp(handle)))


def _residual(rows: _Rows, geometry: Geometry) -> Callable[[Vector], Vector]:
    fitted = slice(rows.settled, rows.learned)

    def residual(x: Vector) -> Vector:
        bends, tensions = rows.predict(x, geometry, rows.learned)
        off = (bends[fitted] - rows.bend[fitted]) / BEND_SCALE_RAD
        if rows.tension is None:
            return off
        trust = TENSION_SCALE * float(rows.tension.max())
        pulls = (exp(x[7]) * tensions[fitted] - rows.tension[fitted]) / trust
        return np.append(off, pulls.T.ravel())

    return residual


def _cable(x: Vector) -> Cable:
    return Cable(
        wrap_friction=float(x[0]),
        section_friction=float(x[1]),
        stiffness=exp(x[2]),
        slack_m=float(x[3]),
        sheath=float(x[4]),
    )


def _vector(cable: Cable) -> list[float]:
    start = [cable.wrap_friction, cable.section_friction, log(cable.stiffness)]
    return [*start, cable.slack_m, cable.sheath, 0.0, 0.0, log(0.05)]


def _search(residual: Callable[[Vector], Vector], start: Sequence[float]) -> OptimizeResult:
    """Least squares from one start, of as many numbers as it has."""
    n = len(start)
    return least_squares(
        residual,
        start,
        x_scale=SCALE[:n],
        bounds=(LOW[:n], HIGH[:n]),
        diff_step=1e-3,
        max_nfev=40,
    )


def _cost(found: OptimizeResult) -> float:
    return float(found.cost)


def _noise(bend: Vector) -> float:
    """Noise of single rows, from second differences; the median passes turns over."""
    return float(1.4826 * np.median(np.abs(np.diff(bend, 2))) / np.sqrt(6))


def _parameters(found: OptimizeResult, model_rad: float) -> dict[str, Parameter]:
    """Values and uncertainties, of what was fitted and of what follows from it."""
    x = found.x
    parameter = Spread(
        residuals=found.fun,
        jacobian=found.jac,
        scale=SCALE[: len(x)],
        stuck=(found.active_mask != 0).tolist(),
        model_error=model_rad / BEND_SCALE_RAD,
    ).parameter
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


def _play(rows: _Rows) -> float:
    """Held-out error of the best play operator with gain and zero [rad]."""

    def predict(x: Vector) -> Vector:
        gain, width, zero = x
        at, out = 0.0, []
        for angle in rows.handle.tolist():
            at = min(max(at, angle - width / 2), angle + width / 2)
            out.append(gain * at + zero)
        return np.array(out)

    def cost(x: Vector) -> float:
        return _rms((predict(x) - rows.bend)[rows.settled : rows.learned])

    gain = np.ptp(rows.bend) / np.ptp(rows.handle)
    best = minimize(cost, [gain, 0.3, 0.0], method="Nelder-Mead")
    return _rms((predict(best.x) - rows.bend)[rows.learned :])


def _rms(values: Vector) -> float:
    return float(np.sqrt(np.mean(values**2)))
