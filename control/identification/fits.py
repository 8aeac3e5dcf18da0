"""Fits the transmission of one axis to a slow log of handle angles and bends.

The model is control/transmission/quasi_static.py with the geometry held constant. The fit finds
mu Theta, mu_b, k/K, the signed slack, the sheath's friction over K, and, as nuisance parameters,
the zero errors of handle and tip; with tensions also K. It uses the first two thirds of the log and
predicts the last third.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import exp, radians

import numpy as np
from scipy.optimize import OptimizeResult, least_squares, minimize

from endolock.control.identification.cable_parameters import (
    HIGH,
    LOW,
    SCALE,
    CableParameters,
    with_uncertainty,
)
from endolock.control.identification.handle_log import HandleLog, LogRows, rows_of
from endolock.control.identification.uncertainty import Parameter
from endolock.control.rms import rms
from endolock.control.transmission.plays import play
from endolock.control.transmission.quasi_static import Cable, Geometry
from endolock.hw.api import Vector

STEP_RAD = 0.018
"""Handle travel between the samples that are kept [rad]; turning points are kept too."""
BEND_SCALE_RAD = radians(0.1)
"""Weight of a bend against a tension: an error of this size counts 1 [rad]."""
TENSION_SCALE = 0.02
"""The same for a tension, as a fraction of the largest tension."""
MODEL_ERROR_RAD = radians(0.02)
"""Deviation of a slowly moving twin from this model, rms [rad]. A larger residual, less the noise,
is used instead."""
MISFIT_RAD, MISFIT = radians(0.15), 0.5
"""A fit is rejected if its residual, less the noise, exceeds this angle [rad] and this multiple of
the noise: the plant works differently or has another geometry, and nothing is determined."""
COARSE = 3
"""Factor on `STEP_RAD` in the first search."""
STARTS = (
    Cable(conduit_exponent=0.5, section_friction=0.15, stiffness=8e4, slack_m=-2e-3, sheath=0.01),
    Cable(conduit_exponent=0.5, section_friction=0.15, stiffness=8e4, slack_m=5e-4, sheath=0.01),
    Cable(
        conduit_exponent=0.15, section_friction=0.02, stiffness=2.5e4, slack_m=-1.5e-2, sheath=0.01
    ),
)
"""Starting points: tight wires, slack wires, and soft wires under high tension."""


@dataclass(frozen=True, kw_only=True)
class CableFit:
    """Result of a fit."""

    cable: Cable
    """The fitted cable."""
    bending_stiffness: float | None
    """K [N m/rad]; None without tensions."""
    params: dict[str, Parameter]
    """Figures with their uncertainties, by the names used in records."""
    noise_rad: float
    """Noise of single bends [rad]."""
    fit_rms_rad: float
    """Residual of the fitted bends, rms [rad]."""
    misfit: bool
    """Whether the residual is so far above the noise that the plant must be of another kind."""
    heldout_rms_rad: float
    """Error of the predicted bends in the last third, rms [rad]."""
    play_heldout_rms_rad: float
    """The same for the best play of constant width, the usual model of hysteresis [rad]."""
    samples: int
    """Number of rows kept of the log."""


def fit(log: HandleLog, geometry: Geometry) -> CableFit:
    """Fit the transmission of the axis that was moved.

    Args:
        log: a slow log of at least two turns.
        geometry: held constant.
    """
    coarse = _residual(rows_of(log, COARSE * STEP_RAD), geometry)
    rows = rows_of(log, STEP_RAD)
    free = len(SCALE) if rows.tension is not None else len(SCALE) - 1
    starts = [CableParameters.start(cable)[:free] for cable in STARTS]
    near = min((_search(coarse, start) for start in starts), key=_cost)
    best = _search(_residual(rows, geometry), near.x)
    found = CableParameters.of(best.x)

    fitted, held_out = slice(rows.settled, rows.learned), slice(rows.learned, None)
    off = rows.predict(found, geometry)[0] - rows.bend
    noise, left = log.noise_rad, rms(off[fitted])
    excess = float(np.sqrt(max(left**2 - noise**2, 0.0)))
    misfit = excess > max(MISFIT_RAD, MISFIT * noise)
    params = with_uncertainty(best, max(excess, MODEL_ERROR_RAD) / BEND_SCALE_RAD)
    if misfit:
        params = {name: replace(figure, determined=False) for name, figure in params.items()}
    return CableFit(
        cable=found.cable,
        bending_stiffness=exp(found.log_bending_stiffness) if rows.tension is not None else None,
        params=params,
        noise_rad=noise,
        fit_rms_rad=left,
        misfit=misfit,
        heldout_rms_rad=rms(off[held_out]),
        play_heldout_rms_rad=_play(rows),
        samples=rows.samples,
    )


def _residual(rows: LogRows, geometry: Geometry) -> Callable[[Vector], Vector]:
    fitted = slice(rows.settled, rows.learned)

    def residual(x: Vector) -> Vector:
        parameters = CableParameters.of(x)
        bends, tensions = rows.predict(parameters, geometry, rows.learned)
        off = (bends[fitted] - rows.bend[fitted]) / BEND_SCALE_RAD
        if rows.tension is None:
            return off
        trust = TENSION_SCALE * float(rows.tension.max())
        pulls = exp(parameters.log_bending_stiffness) * tensions[fitted] - rows.tension[fitted]
        return np.append(off, (pulls / trust).T.ravel())

    return residual


def _search(residual: Callable[[Vector], Vector], start: Sequence[float]) -> OptimizeResult:
    """Least squares over as many parameters as the start has."""
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


def _play(rows: LogRows) -> float:
    """Held-out error of the best play operator with gain and zero [rad]."""

    def predict(x: Vector) -> Vector:
        gain, width, zero = x
        bend: Vector = gain * play(rows.handle, width / 2) + zero
        return bend

    def cost(x: Vector) -> float:
        return rms((predict(x) - rows.bend)[rows.settled : rows.learned])

    gain = np.ptp(rows.bend) / np.ptp(rows.handle)
    best = minimize(cost, [gain, 0.3, 0.0], method="Nelder-Mead")
    return rms((predict(best.x) - rows.bend)[rows.learned :])
