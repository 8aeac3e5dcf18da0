"""Margins, tuning, step identification, describing functions and floors against closed forms."""

from __future__ import annotations

from math import degrees, pi

import control as ct
import numpy as np
import pytest

from endolock.control import analysis, registry
from endolock.control.transmission.linear_process import Process, simc
from endolock.control.transmission.plays import play, play_step
from endolock.hw.api import Vector

INSTANT = Process(gain=1.4, lag_s=0.0, dead_s=0.43)
GRID = 2e-3  # frequencies are 0.17 % apart


@pytest.mark.parametrize("k", [0.3, 0.8, 1.5])
def test_margins_of_an_integrator_with_dead_time(k: float) -> None:
    ki = k / INSTANT.gain
    predicted = analysis.margins(lambda s: ki / s, INSTANT)
    assert predicted.gain == pytest.approx(pi / 2 / (k * INSTANT.dead_s), rel=GRID)
    assert predicted.phase_deg == pytest.approx(90 - degrees(k * INSTANT.dead_s), abs=0.2)
    assert predicted.dead_s == pytest.approx(pi / 2 / k - INSTANT.dead_s, abs=0.002)


def test_a_loop_that_is_unstable_has_a_gain_margin_below_one() -> None:
    ki = 1.2 * pi / 2 / INSTANT.dead_s / INSTANT.gain
    assert analysis.margins(lambda s: ki / s, INSTANT).gain == pytest.approx(1 / 1.2, rel=GRID)


@pytest.mark.parametrize("lag_s", [0.0, 0.025, 0.2])
def test_simc_gains_leave_a_gain_margin_of_pi(lag_s: float) -> None:
    process = Process(gain=2.0, lag_s=lag_s, dead_s=0.4)
    kp, ki = simc(process)
    # with tc = L the lag is cancelled: L(s) = exp(-L s)/(2 L s)
    assert analysis.margins(lambda s: kp + ki / s, process).gain == pytest.approx(pi, rel=GRID)


# they know the target (oracle), do nothing (still), or estimate and choose as they go (predictive)
NOT_LINEAR = {"oracle", "predictive", "predictive_bank", "still"}


@pytest.mark.parametrize("name", sorted(set(registry.LAWS) - NOT_LINEAR - {"repetitive"}))
def test_every_linear_controller_is_stable_with_its_defaults(name: str) -> None:
    process = Process(gain=1.394)
    response = analysis.response(registry.configure(name), process)
    assert response is not None
    assert analysis.margins(response, process).gain > 1.5


@pytest.mark.parametrize("name", sorted(NOT_LINEAR))
def test_a_controller_that_estimates_or_holds_has_no_linear_part(name: str) -> None:
    assert analysis.response(registry.configure(name), INSTANT) is None


@pytest.mark.parametrize("gain", [0.8, 4.0])
def test_a_step_response_gives_gain_lag_and_dead_time(gain: float) -> None:
    t = np.arange(0.01, 1.2, 0.01)
    error = -gain * 0.1 * -np.expm1(-np.maximum(t - 0.413, 0) / 0.06)
    found, misfit = analysis.identify_step(t, error, 0.1)
    assert misfit < 1e-6
    assert (found.gain, found.lag_s, found.dead_s) == pytest.approx((gain, 0.06, 0.413), rel=1e-3)


def test_backlash_causes_no_limit_cycle_in_position_mode() -> None:
    amplitudes = np.geomspace(0.301, 5.0, 100)
    backlash = ct.friction_backlash_nonlinearity(0.6)
    law = ct.tf([0.3, 0.25], [1, 0])
    process = Process(gain=1.394)
    assert analysis.limit_cycles(law, process, backlash, amplitudes) == []
    assert np.ptp(_ring(0.3, 0.25, process, 0.0, 0.3)[-500:]) < 0.02  # settles


def test_over_compensation_oscillates_as_predicted() -> None:
    process = Process(gain=1.394, lag_s=0.02, dead_s=0.43)
    excess = 0.05
    predicted = min(
        analysis.limit_cycles(
            ct.tf([0.3, 0.25], [1, 0]),
            process,
            analysis.OverCompensation(excess),
            np.geomspace(1e-3, 1.0, 300),
        ),
        key=lambda cycle: cycle.omega_rad_s,
    )
    course = _ring(0.3, 0.25, process, 0.3 + excess, 0.3)
    late = course[len(course) // 2 :]
    crossings = np.flatnonzero(np.diff(np.sign(late - late.mean())) > 0)
    omega = 2 * pi / (np.diff(crossings).mean() * 0.002)
    t = 0.002 * np.arange(crossings[0], crossings[-1])
    first = 2 * np.abs(np.mean(late[crossings[0] : crossings[-1]] * np.exp(-1j * omega * t)))
    # The loop hardly filters: the tip's course is nearly square, and kp hands that on to v, where
    # the theory has a sine. The frequency stands that, the size is right within a factor.
    assert omega == pytest.approx(predicted.omega_rad_s, rel=0.25)
    assert first == pytest.approx(predicted.amplitude_rad, rel=0.6)


def test_a_measured_describing_function_agrees_with_the_formula() -> None:
    process = Process(gain=1.394, lag_s=0.02, dead_s=0.43)
    formula = analysis.limit_cycles(
        ct.tf([0.3, 0.25], [1, 0]),
        process,
        analysis.OverCompensation(0.05),
        np.geomspace(1e-3, 1.0, 300),
    )

    def chain(v: Vector) -> Vector:
        return play(v + 0.35 * np.sign(np.gradient(v)), 0.3)

    predicted = analysis.ringing(lambda s: 0.3 + 0.25 / s, process, chain, period_s=0.002)
    assert predicted is not None
    slowest = min(formula, key=lambda cycle: cycle.omega_rad_s)
    assert predicted.omega_rad_s == pytest.approx(slowest.omega_rad_s, rel=0.02)  # sampling
    assert predicted.amplitude_rad == pytest.approx(slowest.amplitude_rad, rel=0.05)


def test_the_lower_bound_of_prediction() -> None:
    def floor(horizon_s: float, noise: float = 0.0) -> float:
        return analysis.wiener_floor(30.0, 0.3, horizon_s, noise)

    assert floor(1e-6) < 1e-3  # known at the observation without noise
    assert floor(20.0) == pytest.approx(30.0 / (2 * pi * 0.3), rel=1e-3)  # rms of the motion itself
    assert floor(0.2) < floor(0.4) < floor(0.8)
    assert floor(0.4) < floor(0.4, noise=1.0)


def _ring(kp: float, ki: float, process: Process, half: float, radius: float) -> Vector:
    """Simulate controller, compensation and play with dead time; return the controller's output."""
    dt = 0.002
    delay = round(process.dead_s / dt)
    line = [0.0] * delay
    integral = tip = z = v_before = 0.0
    error, course = 0.1, []
    for n in range(30000):
        late = line[n % delay]
        error = (0.1 if n < 50 else 0.0) - late
        integral += ki * error * dt
        v = integral + kp * error
        handle = v + half * np.sign(v - v_before)
        v_before = v
        z = play_step(z, handle, radius)
        tip += dt / process.lag_s * (process.gain * z - tip)
        line[n % delay] = tip
        course.append(v)
    return np.array(course)
