"""Parameter uncertainty of a least-squares fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from endolock.hw.api import Vector

DETERMINED = 0.05
"""Largest ratio of standard deviation to value of a parameter that is called determined, so that
two standard deviations are 10 %."""
NO_EFFECT = 1e-6
"""Smallest change of the residuals that counts, for a step of a parameter by its scale: a direction
without effect gets a very large uncertainty instead of an infinite one."""


@dataclass(frozen=True)
class Parameter:
    """One fitted number.

    Args:
        value: its value, in SI units.
        std: its standard deviation, in SI units.
        determined: whether two standard deviations are at most 10 % of the value.
    """

    value: float
    std: float
    determined: bool


class Spread:
    """Uncertainties at a minimum, from the curvature there.

    Neighbouring residuals are correlated where the model is wrong: with correlation rho the noise
    variance is multiplied by (1 + rho)/(1 - rho). An error of the model does not average out; it is
    added as if all of it acted along the parameter in question, e sqrt(n) for n residuals of size
    e.

    Args:
        names: names of the fitted numbers, p.
        residuals: residuals at the minimum, in order of time, n.
        jacobian: derivatives of the residuals, n x p.
        scale: typical changes of the fitted numbers, p.
        stuck: whether each of them lies on a bound, p; it is then not determined.
        model_error: rms error of the model, in units of the residuals.
    """

    def __init__(
        self,
        *,
        names: Sequence[str],
        residuals: Vector,
        jacobian: Vector,
        scale: Sequence[float],
        stuck: Sequence[bool],
        model_error: float,
    ) -> None:
        _, sizes, rows = np.linalg.svd(jacobian * np.asarray(scale), full_matrices=False)
        self._root = rows / np.maximum(sizes, NO_EFFECT)[:, np.newaxis] * np.asarray(scale)
        self._names, self._stuck = list(names), stuck
        rho = max(0.0, float(np.corrcoef(residuals[1:], residuals[:-1])[0, 1]))
        noise = float(np.mean(residuals**2)) * (1 + rho) / (1 - rho)
        self._factor = float(np.sqrt(noise + len(residuals) * model_error**2))

    def parameter(self, value: float, gradient: Mapping[str, float]) -> Parameter:
        """Return one figure with its uncertainty.

        Args:
            value: its value, in SI units.
            gradient: its derivatives by the fitted numbers that it depends on, by name.
        """
        columns = [self._names.index(name) for name in gradient]
        direction = self._root[:, columns] @ np.array(list(gradient.values()))
        std = self._factor * float(np.linalg.norm(direction))
        stuck = any(self._stuck[column] for column in columns)
        return Parameter(value, std, 0 < std <= DETERMINED * abs(value) and not stuck)
