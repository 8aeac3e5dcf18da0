"""Identification from logs of our own twins, and from logs of plants of another kind."""

from dataclasses import replace
from functools import cache
from itertools import pairwise
from math import degrees, pi, radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.control.identification.fits import CableFit, fit
from endolock.control.identification.handle_log import HandleLog
from endolock.control.transmission.quasi_static import Geometry
from endolock.control.transmission.simulation import thin
from endolock.scripts.checks.strokes import still, turn
from endolock.twin.physics.foreign_plants import SUM_OF_PLAYS, BoucWen
from endolock.twin.physics.surrogate_plant import Transmission, bend_of
from endolock.twin.world.instrument import Instrument

PEAK_RAD, SPEED_RAD_S, NOISE_RAD = 2.6, 0.2, radians(0.1)
VARIED = (
    "bending_stiffness",
    "wire_stiffness",
    "slack_m",
    "conduit_friction",
    "section_friction",
)


def random_twin(seed: int) -> Instrument:
    """An instrument with all fitted parameters up to 30 % off."""
    random = np.random.default_rng(seed)
    usual = Instrument()
    changes = {name: getattr(usual, name) * random.uniform(0.7, 1.3) for name in VARIED}
    return replace(usual, **changes, sheath_friction_nm=random.uniform(0.0, 0.004))


def triangle(peak: float = PEAK_RAD, periods: int = 3) -> list[tuple[float, float]]:
    quarter = peak / SPEED_RAD_S
    crests = [(quarter * (2 * n + 1), peak * (-1) ** n) for n in range(2 * periods + 1)]
    return [(0.0, 0.0), *crests]


@cache
def log_of(instrument: Instrument, seed: int, *, tensions: bool = False) -> HandleLog:
    """Record three periods at 50 Hz with a noisy tracker and an encoder of 0.09 deg."""
    plant = still(instrument)
    random, step = np.random.default_rng(seed), instrument.encoder_step_rad
    motion = turn(plant, triangle())
    rows = slice(None, None, 2)
    nothing = np.zeros(len(motion.t[rows]))
    handle = np.round(motion.handle[rows] / step) * step
    bend = motion.bend[rows] + NOISE_RAD * random.standard_normal(len(nothing))
    pulls = None
    if tensions:
        wires = motion.proximal[rows], nothing, motion.opposite[rows], nothing
        measured = np.column_stack(wires)
        pulls = np.maximum(measured + 0.1 * random.standard_normal(measured.shape), 0.0)
    return HandleLog(
        motion.t[rows],
        np.column_stack([handle, nothing]),
        np.column_stack([bend, nothing]),
        pulls,
    )


def truth(instrument: Instrument) -> dict[str, float]:
    stiffness = instrument.bending_stiffness
    pretension = max(0.0, -instrument.slack_m * instrument.wire_stiffness)
    return {
        "mu_wrap": instrument.conduit_exponent_at(pi),
        "mu_section": instrument.section_friction,
        "k_over_K": instrument.wire_stiffness / stiffness,
        "slack_m": max(0.0, instrument.slack_m),
        "pretension_over_K": pretension / stiffness,
        "sheath_over_K": instrument.sheath_friction_nm / stiffness,
        "bending_stiffness": stiffness,
        "wire_stiffness": instrument.wire_stiffness,
        "pretension_n": pretension,
    }


def check(found: CableFit, instrument: Instrument, expected: set[str]) -> None:
    """Check that determined values are right to 10 %, and that the expected ones are determined."""
    right = truth(instrument)
    determined = {name for name, p in found.params.items() if p.determined}
    assert not found.misfit
    assert expected <= determined
    for name in determined:
        assert found.params[name].value == pytest.approx(right[name], rel=0.1), name
    for name, p in found.params.items():
        assert abs(p.value - right[name]) <= 3 * p.std, name  # the uncertainty is realistic
    # noise of 0.1 deg, and a smaller error of the model
    assert degrees(found.heldout_rms_rad) < 0.2
    assert found.play_heldout_rms_rad > 10 * found.heldout_rms_rad


TIGHT = {"mu_wrap", "mu_section", "k_over_K", "pretension_over_K"}


def test_a_twin_is_found() -> None:
    twin = random_twin(0)
    check(fit(log_of(twin, 0), Geometry()), twin, TIGHT)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_ten_twins_are_found(seed: int) -> None:
    twin = random_twin(seed)
    check(fit(log_of(twin, seed), Geometry()), twin, TIGHT)


@pytest.mark.parametrize("missing", [pytest.param(0.03, marks=pytest.mark.slow), 0.1, 0.25])
def test_a_log_may_start_anywhere(missing: float) -> None:
    """In the first stroke out, in the one back, and after it; the model starts at rest."""
    twin, whole = random_twin(0), log_of(random_twin(0), 0)
    rows = slice(int(missing * len(whole.t)), None)
    check(
        fit(HandleLog(whole.t[rows], whole.handle[rows], whole.bend[rows]), Geometry()), twin, TIGHT
    )


def test_with_a_wrong_geometry_nothing_is_determined() -> None:
    """With 10 hinges instead of 12, k/K is 17 % too small, and there is a misfit."""
    whole = log_of(random_twin(2), 2, tensions=True)  # which another test has recorded
    found = fit(HandleLog(whole.t, whole.handle, whole.bend), Geometry(hinges=10))
    assert found.misfit
    assert not any(p.determined for p in found.params.values())


def test_slack_and_sheath_friction_are_found() -> None:
    twin = Instrument(slack_m=0.0005, wire_stiffness=6000.0, sheath_friction_nm=0.004)
    expected = {"mu_wrap", "mu_section", "k_over_K", "slack_m", "sheath_over_K"}
    check(fit(log_of(twin, 0), Geometry()), twin, expected)


def test_tensions_give_absolute_values() -> None:
    twin = random_twin(2)
    found = fit(log_of(twin, 2, tensions=True), Geometry())
    absolute = {"bending_stiffness", "wire_stiffness", "pretension_n"}
    check(found, twin, TIGHT | absolute)
    assert found.bending_stiffness == found.params["bending_stiffness"].value


@pytest.mark.parametrize(
    ("plant", "worst"),
    [
        (BoucWen(), 0.7),  # it slides gradually, which a play does not
        (SUM_OF_PLAYS, 0.7),  # neither model has several widths
    ],
)
def test_a_plant_of_another_kind_is_a_misfit(plant: Transmission, worst: float) -> None:
    """Not an inverse crime: this log is not from the fitted model."""
    times, angles = zip(*triangle(2.0), strict=True)
    t = np.arange(0.0, times[-1], 0.02)
    handle = np.interp(t, times, angles)
    bend = bend_of(plant, handle) + NOISE_RAD * np.random.default_rng(0).standard_normal(len(t))
    nothing = np.zeros(len(t))
    log = HandleLog(t, np.column_stack([handle, nothing]), np.column_stack([bend, nothing]))
    found = fit(log, Geometry())
    assert found.noise_rad == pytest.approx(NOISE_RAD, rel=0.1)  # of 4000 rows
    assert found.misfit
    assert found.fit_rms_rad > 3 * found.noise_rad
    assert not any(p.determined for p in found.params.values())
    # it still predicts: within 2 % of the range, no worse than in the fitted part
    assert found.heldout_rms_rad < 0.02 * np.ptp(bend)
    assert found.heldout_rms_rad < 1.3 * found.fit_rms_rad  # the last period is like the others
    assert found.heldout_rms_rad < worst * found.play_heldout_rms_rad


@given(
    corners=st.lists(st.floats(-2, 2), min_size=2, max_size=6),
    step=st.floats(0.01, 0.1),
    rows=st.integers(50, 300),
)
def test_thinning_keeps_reversals_and_steps(corners: list[float], step: float, rows: int) -> None:
    handle = np.concatenate([np.linspace(a, b, rows) for a, b in pairwise(corners)])
    kept = thin(handle, step)
    assert kept[0] == 0
    assert all(a < b for a, b in pairwise(kept))
    most = float(np.abs(np.diff(handle)).max())
    assert np.abs(np.diff(handle[kept])).max(initial=0.0) <= step + most + 1e-9
    # the error between is at most a step, a reversal too small to keep, and a row
    between = np.interp(np.arange(len(handle)), kept, handle[kept])
    assert np.abs(between - handle)[: kept[-1]].max(initial=0.0) <= 1.25 * step + most + 1e-9
    for n in (handle.argmax(), handle.argmin()):
        if n < kept[-1]:
            assert np.abs(handle[kept] - handle[n]).min() <= step / 4 + most + 1e-9
