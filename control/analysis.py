"""Linear and describing-function analysis of a loop, with python-control, offline.

The loop is L(s) = C(s) K exp(-L s)/(T s + 1), with the process of
control/transmission/linear_process.py and a controller's response C from error to handle. Dead time
is exact: margins are taken from the frequency response.

Reference:
    K. J. Astrom and R. M. Murray, Feedback Systems, 2nd ed., ch. 10 (margins, describing
    functions); N. Wiener's prediction problem, here by the Kalman filter.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi, sqrt
from typing import Any, NamedTuple

import control as ct
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import least_squares

from endolock.control.laws.hysteresis_compensation import PIHCSettings, SimcHCSettings
from endolock.control.laws.ik_sync import IKSyncSettings
from endolock.control.laws.inverse_kinematics import IKSettings
from endolock.control.laws.pi import PISettings
from endolock.control.laws.pi_simc import SimcSettings
from endolock.control.laws.smith import SmithSettings
from endolock.control.rms import rms
from endolock.control.transmission.kinematics import SectionGeometry
from endolock.control.transmission.linear_process import HOLD_S, Process, image_gain, simc
from endolock.hw.api import PERIOD_S, Vector

OMEGA = np.geomspace(1e-2, 3e2, 6000)
"""Angular frequencies of the frequency response [rad/s]: periods of 10 min to 20 ms."""
PADE = 8
"""Order of the Pade approximation of the dead time."""
PADE_REACH = 9.0
"""Largest product of angular frequency and dead time at which it is used: an error of 1 deg."""

Complex = NDArray[np.complex128]
Response = Callable[[Complex], Complex]
"""Handle angle per error of a controller, complex, at s = j omega."""


class Margins(NamedTuple):
    """Stability margins of a loop."""

    gain: float
    """Gain margin [1]; a loop with less than 1 is unstable."""
    phase_deg: float
    """Phase margin, the smallest over all crossovers [deg]."""
    dead_s: float
    """Delay margin [s]."""


def response(settings: Any, process: Process) -> Response | None:
    """Return the linear part of a controller; None if it has none, as the oracle.

    Args:
        settings: settings of the controller.
        process: the controlled process; its dead time is the age of frames plus the hold.
    """
    geometry = SectionGeometry()

    def gain(own: Any) -> float:
        return image_gain(geometry, own.target_distance_m, own.bend_per_handle)

    age_s = process.dead_s - HOLD_S
    match settings:
        case PISettings() | PIHCSettings():
            kp, ki = settings.kp, settings.ki
            return lambda s: kp + ki / s
        case SimcSettings() | SimcHCSettings():
            kp, ki = simc(Process(gain=gain(settings), dead_s=process.dead_s))
            return lambda s: kp + ki / s
        case IKSettings():
            ki = settings.rate_per_s / gain(settings)
            return lambda s: ki / s
        case IKSyncSettings():
            # aim = h(t - L) + e/K, and h follows it with a lag
            k, settle = gain(settings), settings.settle_s
            return lambda s: 1 / k / (1 + settle * s - np.exp(-age_s * s))
        case SmithSettings():
            k, tc = gain(settings), settings.closed_loop_s
            return lambda s: 1 / k / (tc * s + 1 - np.exp(-age_s * s))
    return None


def margins(controller: Response, process: Process) -> Margins:
    """Compute the margins of a loop.

    Args:
        controller: linear part of the controller.
        process: the controlled process.
    """
    s = (1j * OMEGA).astype(np.complex128)
    loop = controller(s) * process.gain * np.exp(-process.dead_s * s) / (process.lag_s * s + 1)
    gm, pm, _, _, wgc, _ = ct.stability_margins(ct.frd(loop, OMEGA, smooth=True), returnall=True)
    # With several crossings, the smallest counts.
    lag = np.radians(pm % 360)
    gain = float(np.min(gm, initial=np.inf))
    phase = float(np.degrees(np.min(np.minimum(lag, 2 * pi - lag), initial=np.inf)))
    dead = float(np.min(lag / wgc, initial=np.inf))
    return Margins(gain, phase, dead)


def identify_step(t: Vector, error: Vector, step_rad: float) -> tuple[Process, float]:
    """Identify gain, lag and dead time from the response to a step of the handle at t = 0.

    Args:
        t: times of the errors, n [s].
        error: change of the error since the step, n [rad]; it falls for a positive step.
        step_rad: size of the step [rad].

    Returns:
        The process, and the rms residual [rad].
    """

    def misfit(x: Vector) -> Vector:
        gain, lag, dead = x
        since = np.maximum(t - dead, 0.0)
        misfit: Vector = error + gain * step_rad * -np.expm1(-since / max(lag, 1e-4))
        return misfit

    gain = -float(error[-1]) / step_rad
    moved = np.abs(error) > 0.5 * abs(float(error[-1]))
    start = [max(gain, 1e-3), 0.03, max(float(t[int(moved.argmax())]) - 0.02, 0.01)]
    best = least_squares(
        misfit, start, bounds=([1e-6, 1e-4, 1e-3], [1e3, 5.0, 10.0]), x_scale=start
    )
    gain, lag, dead = (float(x) for x in best.x)
    return Process(gain=gain, lag_s=lag, dead_s=dead), rms(best.fun)


class LimitCycle(NamedTuple):
    """A predicted oscillation."""

    amplitude_rad: float
    """Amplitude of the controller's output [rad]."""
    omega_rad_s: float
    """Angular frequency [rad/s]."""


class OverCompensation(ct.DescribingFunctionNonlinearity):  # type: ignore[misc]  # untyped
    """Play of half-width r after a compensation of half-width c > r, which jumps at each reversal.

    The output is v + (c - r) sign(v'), so N(A) = 1 + 4j (c - r)/(pi A).

    Args:
        excess_rad: c - r [rad].
    """

    def __init__(self, excess_rad: float) -> None:
        super().__init__()
        self._excess = excess_rad

    def describing_function(self, amplitude: float) -> complex:
        """Return N(A)."""
        return 1 + 4j * self._excess / (pi * amplitude)


def limit_cycles(
    controller: ct.TransferFunction, process: Process, nonlinearity: Any, amplitudes: Vector
) -> list[LimitCycle]:
    """Predict oscillations where L(jw) = -1/N(A).

    Args:
        controller: linear part of the controller, as a transfer function.
        process: the controlled process.
        nonlinearity: one of python-control's, or `OverCompensation`.
        amplitudes: amplitudes at which it is evaluated, rising [rad].
    """
    top, bottom = ct.pade(process.dead_s, PADE)
    plant = ct.tf([process.gain], [process.lag_s, 1]) * ct.tf(top, bottom)
    omega = OMEGA[OMEGA * process.dead_s < PADE_REACH]
    found = ct.describing_function_response(
        controller * plant, nonlinearity, amplitudes, omega, warn_nyquist=False
    )
    return [LimitCycle(float(a), float(w)) for a, w in found.intersections]


def ringing(
    controller: Response,
    process: Process,
    chain: Callable[[Vector], Vector],
    period_s: float = PERIOD_S,
) -> LimitCycle | None:
    """Predict an oscillation with a simulated describing function, N(A, w).

    For nonlinearities that also depend on frequency, such as a compensation after a low-pass: the
    chain is driven with A sin(wt), and 1 + L(jw) N(A, w) = 0 is solved.

    Args:
        controller: linear part of the controller.
        process: the controlled process.
        chain: maps a history of the controller's output to that of the bend, tick by tick [rad].
        period_s: control period [s].

    Returns:
        The oscillation; None if none is found.
    """

    def residual(x: Vector) -> Vector:
        amplitude, omega = np.exp(x)
        periods = max(4, round(3.0 * omega / (2 * pi)))
        t = np.arange(0.0, 2 * pi * periods / omega, period_s)
        bend = chain(amplitude * np.sin(omega * t))
        last = t > 2 * pi * (periods - 2) / omega
        waves = np.column_stack([np.sin(omega * t), np.cos(omega * t), np.ones(len(t))])[last]
        real, imaginary, _ = np.linalg.lstsq(waves, bend[last], rcond=None)[0]
        s = np.array([1j * omega])
        loop = controller(s) * process.gain * np.exp(-process.dead_s * s) / (process.lag_s * s + 1)
        left = 1 + loop[0] * (real + 1j * imaginary) / amplitude
        return np.array([left.real, left.imag])

    starts = [(a, w) for a in (0.02, 0.1, 0.3, 1.0) for w in (2.0, 4.0, 6.0, 9.0)]
    for start in starts:
        found = least_squares(residual, np.log(start), diff_step=1e-2)
        if np.abs(found.fun).max() < 0.02:
            amplitude, omega = np.exp(found.x)
            return LimitCycle(float(amplitude), float(omega))
    return None


def wiener_floor(
    speed_rms: float, cutoff_hz: float, horizon_s: float, noise: float, frame_s: float = 0.04
) -> float:
    """Smallest rms error of any prediction of a random target, in the unit of the position.

    The target is white noise through x'' + 2 z w x' + w^2 x with z = 1/sqrt(2), observed with
    noise. The Kalman filter estimates it best; prediction adds the noise over the horizon.

    Args:
        speed_rms: rms speed along one axis, in units of position per second.
        cutoff_hz: cut-off frequency of the low-pass [Hz].
        horizon_s: time from exposure to the effect of a command [s].
        noise: standard deviation of each observation, in units of position.
        frame_s: time between observations [s].
    """
    w = 2 * pi * cutoff_hz
    a = np.array([[0.0, 1.0], [-(w**2), -sqrt(2) * w]])
    stationary = np.diag([(speed_rms / w) ** 2, speed_rms**2])

    def step(dt: float) -> tuple[Vector, Vector]:
        phi = expm(a * dt)
        driven = stationary - phi @ stationary @ phi.T
        return phi, (driven + driven.T) / 2  # symmetric to the last bit

    phi, driven = step(frame_s)
    seen = np.array([[1.0, 0.0]])
    # dlqe expects E Q E'; the P it returns is the covariance before each observation.
    _, before, _ = ct.dlqe(phi, np.eye(2), seen, driven, np.array([[max(noise, 1e-9) ** 2]]))
    gain = before @ seen.T / (seen @ before @ seen.T + noise**2)
    after = before - gain @ seen @ before
    ahead, later = step(horizon_s)
    return float(sqrt((ahead @ after @ ahead.T + later)[0, 0]))
