"""Parameters of a cable as the fit searches for them, and the figures derived from them."""

from __future__ import annotations

from math import exp, log
from typing import NamedTuple

from scipy.optimize import OptimizeResult

from endolock.control.identification.uncertainty import Parameter, Spread
from endolock.control.transmission.quasi_static import Cable
from endolock.hw.api import Vector


class CableParameters(NamedTuple):
    """Parameters of the fit, in the order of the solver's vector."""

    conduit_exponent: float
    """Capstan exponent mu Theta of the conduit [1]."""
    section_friction: float
    """mu_b [1]."""
    log_stiffness: float
    """Logarithm of k/K, k/K in 1/m2."""
    slack_m: float
    """Free length of each wire [m]; negative is pretension."""
    sheath: float
    """Dry friction of the sheath over K [rad]."""
    handle_zero_rad: float
    """Zero error of the logged handle angles [rad]."""
    tip_zero_rad: float
    """Zero error of the logged bends [rad]."""
    log_bending_stiffness: float = log(0.05)
    """Logarithm of K, K in N m/rad; fitted only if the log has tensions, otherwise not used."""

    @classmethod
    def of(cls, x: Vector) -> CableParameters:
        """Make them from the solver's vector, with or without the last one."""
        return cls(*x.tolist())

    @classmethod
    def start(cls, cable: Cable) -> CableParameters:
        """Make the starting point of a search from a cable, without zero errors."""
        return cls(
            conduit_exponent=cable.conduit_exponent,
            section_friction=cable.section_friction,
            log_stiffness=log(cable.stiffness),
            slack_m=cable.slack_m,
            sheath=cable.sheath,
            handle_zero_rad=0.0,
            tip_zero_rad=0.0,
        )

    @property
    def cable(self) -> Cable:
        """The cable with these parameters."""
        return Cable(
            conduit_exponent=self.conduit_exponent,
            section_friction=self.section_friction,
            stiffness=exp(self.log_stiffness),
            slack_m=self.slack_m,
            sheath=self.sheath,
        )


SCALE = CableParameters(
    conduit_exponent=0.3,
    section_friction=0.1,
    log_stiffness=0.3,
    slack_m=1e-3,
    sheath=0.03,
    handle_zero_rad=0.02,
    tip_zero_rad=0.01,
    log_bending_stiffness=0.3,
)
"""Typical changes, for the solver."""
LOW = CableParameters(
    conduit_exponent=1e-3,
    section_friction=0.0,
    log_stiffness=log(2e3),
    slack_m=-0.03,
    sheath=0.0,
    handle_zero_rad=-0.3,
    tip_zero_rad=-0.2,
    log_bending_stiffness=log(1e-4),
)
HIGH = CableParameters(
    conduit_exponent=4.0,
    section_friction=3.0,
    log_stiffness=log(5e6),
    slack_m=0.02,
    sheath=0.6,
    handle_zero_rad=0.3,
    tip_zero_rad=0.2,
    log_bending_stiffness=log(1e2),
)
"""Bounds of the search."""


def figures(cable: Cable) -> dict[str, float]:
    """Return the figures of a cable by the names used in records."""
    return {
        "mu_wrap": cable.conduit_exponent,
        "mu_section": cable.section_friction,
        "k_over_K": cable.stiffness,
        "slack_m": max(0.0, cable.slack_m),
        "pretension_over_K": max(0.0, -cable.slack_m) * cable.stiffness,
        "sheath_over_K": cable.sheath,
    }


def with_uncertainty(found: OptimizeResult, model_error: float) -> dict[str, Parameter]:
    """Return the figures of a fit with their uncertainties, by the names used in records.

    Args:
        found: result of the search, with or without the last parameter.
        model_error: rms error of the model, in units of the residuals.
    """
    values = CableParameters.of(found.x)
    count = len(found.x)
    parameter = Spread(
        names=CableParameters._fields[:count],
        residuals=found.fun,
        jacobian=found.jac,
        scale=SCALE[:count],
        stuck=(found.active_mask != 0).tolist(),
        model_error=model_error,
    ).parameter
    cable = values.cable
    k, tight = cable.stiffness, max(0.0, -cable.slack_m)
    gradients: dict[str, dict[str, float]] = {
        "mu_wrap": {"conduit_exponent": 1.0},
        "mu_section": {"section_friction": 1.0},
        "k_over_K": {"log_stiffness": k},
        "slack_m": {"slack_m": 1.0},
        "pretension_over_K": {"log_stiffness": tight * k, "slack_m": -k},
        "sheath_over_K": {"sheath": 1.0},
    }
    params = {name: parameter(value, gradients[name]) for name, value in figures(cable).items()}
    if count == len(CableParameters._fields):
        stiff = exp(values.log_bending_stiffness)
        own, pull = k * stiff, tight * k * stiff
        log_k, log_stiff = "log_stiffness", "log_bending_stiffness"
        params["bending_stiffness"] = parameter(stiff, {log_stiff: stiff})
        params["wire_stiffness"] = parameter(own, {log_k: own, log_stiff: own})
        params["pretension_n"] = parameter(pull, {log_k: pull, "slack_m": -own, log_stiff: pull})
    return params
