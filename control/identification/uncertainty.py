"""How well a fit of least squares determines what is told of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from endolock.hw.api import Vector

DETERMINED = 0.05
"""Largest uncertainty of a parameter that is called determined, of its value: so that two of them
are 10 %."""
NO_EFFECT = 1e-6
"""Change of the residuals that is none, for a step of a parameter by its scale: a direction without
effect gets a huge uncertainty, not none."""


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


class Spread:
    """Uncertainties around a minimum, from the curvature there.

    Neighbouring residuals are alike where the model is wrong: with correlation rho the noise counts
    (1 + rho)/(1 - rho) times. An error of the model does not average out; it is added as if it all
    pointed the way of the parameter in question, which n residuals of size e can by e sqrt(n).

    Args:
        names: names of the fitted numbers, p.
        residuals: at the minimum, in the order of time, n.
        jacobian: their derivatives, n x p.
        scale: likely sizes of the fitted numbers, p.
        stuck: whether each of them lies on a bound, p; what does is not determined.
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
        """Tell one number.

        Args:
            value: it, in SI units.
            gradient: its derivatives by those fitted numbers that it depends on.
        """
        columns = [self._names.index(name) for name in gradient]
        direction = self._root[:, columns] @ np.array(list(gradient.values()))
        std = self._factor * float(np.linalg.norm(direction))
        stuck = any(self._stuck[column] for column in columns)
        return Parameter(value, std, 0 < std <= DETERMINED * abs(value) and not stuck)
