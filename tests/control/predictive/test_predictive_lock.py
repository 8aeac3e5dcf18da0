"""The predictive lock and its parts: filters, periods, identification, caution."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.control import loop, metrics, registry
from endolock.control.predictive import online_plays
from endolock.control.predictive.axis_plays import PRIOR, RADII
from endolock.control.predictive.predictive_lock import Predictive
from endolock.control.predictive.target_prediction import Bank, Harmonic, Mover
from endolock.control.transmission.plays import ONE_PLAY, Plays, play
from endolock.twin.surrogate import SurrogateRig
from endolock.twin.world import scenario
from endolock.twin.world.fitted_plays import plays_of
from endolock.twin.world.instrument import Instrument
from endolock.vision.truth_eyes import TruthEyes

FRAME_S = 0.04
HORIZON_S = 0.45


def feed(bank: Bank, course: object, seconds: float = 30.0) -> None:
    for t in np.arange(0.0, seconds, FRAME_S).tolist():
        bank.update(t, course(t), 1e-6, HORIZON_S)  # type: ignore[operator]


@given(speed=st.floats(-1, 1), start=st.floats(-1, 1))
@settings(deadline=None)
def test_constant_velocity_is_predicted_exactly(speed: float, start: float) -> None:
    mover = Mover(0.5)
    for t in np.arange(0.0, 6.0, FRAME_S).tolist():
        mover.update(t, (start + speed * t, -speed * t), 1e-8)
    # the remainder of the initial guess of no motion after 150 frames
    assert mover.at(7.0) == pytest.approx((start + 7 * speed, -7 * speed), abs=1e-3)


def test_the_filter_settles_at_the_kalman_gain() -> None:
    import control as ct

    mover, q, r = Mover(0.3), 0.3, 1e-4
    for n in range(400):
        mover.update(n * FRAME_S, (0.0, 0.0), r)
    phi = np.array([[1.0, FRAME_S], [0.0, 1.0]])
    driven = q * np.array([[FRAME_S**3 / 3, FRAME_S**2 / 2], [FRAME_S**2 / 2, FRAME_S]])
    _, before, _ = ct.dlqe(phi, np.eye(2), np.array([[1.0, 0.0]]), driven, np.array([[r]]))
    after = before[0, 0] * r / (before[0, 0] + r)
    assert mover.covariance[0] == pytest.approx(after, rel=1e-6)  # the same Riccati equation


@pytest.mark.parametrize("period", [3.3, 8.6, 14.0])
def test_a_period_is_found_and_not_its_multiple(period: float) -> None:
    harmonic = Harmonic()
    for t in np.arange(0.0, 32.0, FRAME_S).tolist():
        phase = 2 * pi * t / period
        place = (0.3 * (1 - np.cos(phase)) + 0.05 * np.cos(2 * phase), 0.1 * np.sin(phase))
        harmonic.update(t, (float(place[0]), float(place[1])))
    assert harmonic.period_s == pytest.approx(period, rel=0.01)  # the step of the scan is 0.5 %
    ahead = harmonic.at(32.0 + HORIZON_S)
    phase = 2 * pi * (32.0 + HORIZON_S) / period
    expected = 0.3 * (1 - np.cos(phase)) + 0.05 * np.cos(2 * phase)
    assert ahead is not None
    assert ahead[0] == pytest.approx(expected, abs=0.01)


def test_the_bank_selects_the_predictor_that_was_right() -> None:
    def strokes(t: float) -> tuple[float, float]:
        return 0.3 * (1 - float(np.cos(2 * pi * t / 8.6))), 0.0

    bank = Bank([Mover(0.02, still=True), Mover(0.5)], Harmonic())
    feed(bank, strokes, 45.0)  # until predictions from before the period was known have decayed
    assert bank.chosen == 2
    still = Bank([Mover(0.02, still=True), Mover(0.5)], Harmonic())
    random = np.random.default_rng(0)
    feed(still, lambda t: tuple((0.02 * random.standard_normal(2)).tolist()))
    assert still.chosen != 1  # noise is not velocity


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_weights_and_latency_are_identified_from_frames(noise: float) -> None:
    times = np.arange(0.0, 25.0, 0.02)
    random = np.random.default_rng(1)
    target = 0.3 * (1 - np.cos(2 * pi * times / 8.6)) + 0.05 * np.sin(2 * pi * times / 3.1)
    # Strokes of all sizes, so that every play moves.
    turns = random.uniform(-0.9, 0.9, 26)
    handle = np.interp(times, np.arange(26.0), turns)
    plays = np.stack([np.column_stack([play(handle, r) for r in RADII])] * 2, axis=1)
    true = np.zeros(len(RADII))
    true[[4, 6]] = 0.5, 0.45
    late_s = 0.02
    t = np.arange(1.0, 24.0, FRAME_S)
    bend = np.interp(t + late_s, times, plays[:, 0] @ true)
    seen = np.interp(t + late_s, times, target) - bend + noise * random.standard_normal(len(t))
    found = online_plays.identify(
        t, np.column_stack([seen, seen]), times, plays, np.array(PRIOR), np.array(RADII), 0.0
    )
    assert found is not None
    assert found.shift_s == pytest.approx(late_s)
    weights = found.weights[0]
    assert weights is not None
    width = 2 * (weights @ RADII) / weights.sum()
    expected = 2 * (true @ RADII) / true.sum()
    assert width == pytest.approx(
        expected, rel=0.05
    )  # the splines absorb a little of the reversals


def test_a_handle_at_rest_identifies_nothing() -> None:
    times = np.arange(0.0, 25.0, 0.02)
    t = np.arange(1.0, 24.0, FRAME_S)
    plays = np.zeros((len(times), 2, len(RADII)))
    seen = np.random.default_rng(0).standard_normal((len(t), 2))
    found = online_plays.identify(t, seen, times, plays, np.array(PRIOR), np.array(RADII), 0.0)
    assert found is None


def locked(law: str, name: str, seconds: float, plays: Plays, **changes: float) -> dict[str, float]:
    """Score the second half of a run on the surrogate."""
    rig = SurrogateRig(scenario.load(name, changes), transmission=plays)
    with rig:
        rig.clock.sleep_until(0.0)
        camera = rig.camera.calibration
        run = loop.run(rig, TruthEyes(rig.truth), registry.make(law, camera), duration_s=seconds)
        score = metrics.score(run, camera, seconds / 2).as_dict()
    return {**score["error_px"], **score["handle"], "lost": score["lost_fraction"]}


@pytest.mark.parametrize("latency", [0.2, 0.6])
def test_the_lock_works_without_knowing_the_width(latency: float) -> None:
    score = locked("predictive_bank", "straight", 60.0, ONE_PLAY, **{"camera.latency_s": latency})
    assert score["rms"] < 10  # the limit on the twin; here the plant is a single play
    assert score["lost"] == 0


def test_a_wrong_latency_is_identified() -> None:
    wrong = {"camera.latency_s": 0.48, "camera.nominal_latency_s": 0.4}
    assert locked("predictive_bank", "circle", 60.0, ONE_PLAY, **wrong)["rms"] < 12


def test_with_a_target_at_rest_the_handles_rest() -> None:
    noisy = {"camera.truth_noise_px": 0.3}
    score = locked("predictive_bank", "rest", 40.0, ONE_PLAY, **noisy)
    assert score["rms"] <= 1.0  # the limit in the acceptance test
    assert score["reversals_per_s"] <= 0.5


def test_many_reversals_make_it_cautious_for_a_while() -> None:
    rig = SurrogateRig("rest", transmission=ONE_PLAY)
    law = registry.make("predictive_bank", rig.camera.calibration)
    assert isinstance(law, Predictive)
    with rig:
        rig.actuators.enable()
        law.reset(rig.actuators.exchange(None))
        cautious = []
        for n in range(600):
            t = rig.clock.sleep_until(0.02 * n)
            state = rig.actuators.exchange(None)
            frame = rig.camera.latest()
            seen = TruthEyes(rig.truth)(frame) if frame and n % 2 == 0 else None
            shaken = 80.0 * (-1.0) ** (n // 4) if n < 300 else 0.0
            if seen is not None:
                u, v = seen.target_px
                seen = type(seen)(**{**vars(seen), "target_px": (u + shaken, v)})
            law.update(t, state, seen)
            cautious.append(law.signals["cautious"])
    assert max(cautious[100:300]) == 1.0
    assert cautious[-1] == 0.0


def test_signals_show_the_internal_model() -> None:
    rig = SurrogateRig("straight", transmission=plays_of(Instrument(), 180.0))
    law = registry.make("predictive_bank", rig.camera.calibration)
    with rig:
        rig.clock.sleep_until(0.0)
        run = loop.run(rig, TruthEyes(rig.truth), law, duration_s=30.0)
    signals = run.ticks[-1].signals
    assert 0.1 < signals["width_left_right_rad"] / pi < 0.3  # 0.2 of 180 deg, about
    assert signals["width_std_left_right_rad"] < 0.1
    assert abs(signals["latency_off_s"]) < 0.02
    assert signals["width_up_down_rad"] == 0.0  # that handle never moved
