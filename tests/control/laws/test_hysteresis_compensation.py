"""The forms of compensation, each against its formula."""

from __future__ import annotations

from math import pi, tanh

import numpy as np
import pytest

from endolock.control.laws.hysteresis_compensation import CompensationSettings, Direction, follow
from endolock.control.transmission.plays import play
from endolock.scripts.runs import batch
from endolock.scripts.runs.experiment import Experiment

DT = 0.02
WIDTH = 0.2
SHAFT = {"pretensioned": (), "thesis": ("shaft_bend_deg=0",)}
HALF = WIDTH * pi / 2  # half of 0.2 of 180 deg


def compensation(settings: CompensationSettings, goals: np.ndarray) -> np.ndarray:
    """Compensation for a history of a controller's goals."""
    direction, out = Direction(), []
    direction.behind = float(goals[0])
    for before, now in zip([goals[0], *goals[:-1]], goals, strict=True):
        out.append(follow(settings, direction, float(before), float(now), DT))
    return np.array(out)


def ramp(speed: float, seconds: float = 3.0) -> np.ndarray:
    return speed * np.arange(0.0, seconds, DT)


@pytest.mark.parametrize("form", ["sign", "play", "ramp"])
@pytest.mark.parametrize("speed", [0.3, -0.3])
def test_in_steady_motion_compensation_is_half_the_width(form: str, speed: float) -> None:
    settings = CompensationSettings(form=form)  # type: ignore[arg-type]
    assert compensation(settings, ramp(speed))[-1] == pytest.approx(np.sign(speed) * HALF, rel=1e-9)


def test_smooth_compensation_follows_the_speed() -> None:
    settings = CompensationSettings(form="smooth", smooth_rad_s=0.1)
    expected = HALF * tanh(0.05 / 0.1)
    # 3 s are 37 time constants of the speed's low-pass
    assert compensation(settings, ramp(0.05))[-1] == pytest.approx(expected, rel=1e-6)


def test_compensation_cancels_a_play_of_the_same_width() -> None:
    goals = np.concatenate([ramp(0.3), ramp(0.3)[-1] - ramp(0.3)])
    handle = goals + compensation(CompensationSettings(form="sign"), goals)
    tip = play(handle, HALF)
    settled = np.r_[20 : len(goals) // 2, len(goals) // 2 + 20 : len(goals)]
    assert tip[settled] == pytest.approx(goals[settled], abs=1e-12)  # rounding only


def test_compensation_is_switched_off_at_low_speed() -> None:
    settings = CompensationSettings(form="sign", switch_off_rad_s=0.1)
    assert compensation(settings, ramp(0.05))[-1] == 0.0
    assert compensation(settings, ramp(0.3))[-1] == pytest.approx(HALF)


def test_speed_near_the_threshold_does_not_toggle_the_switch_off() -> None:
    """Goals move in steps at each frame, so the speed has a ripple, here 30 %."""
    settings = CompensationSettings(form="sign")
    speeds = settings.switch_off_rad_s * (1 + 0.3 * (-1.0) ** np.arange(300))
    for start in (0.0, 0.3):  # from rest, and from a quick motion
        goals = np.cumsum(DT * np.concatenate([np.full(50, start), speeds]))
        side = np.sign(compensation(settings, goals))[50:]
        assert np.count_nonzero(np.diff(side)) <= 1


@pytest.mark.parametrize("form", ["sign", "ramp"])
def test_motion_below_the_threshold_counts_as_rest(form: str) -> None:
    """Noise sets no sign: `sign` gives 0, and a ramp holds its value."""
    settings = CompensationSettings(form=form)  # type: ignore[arg-type]
    slow = 0.9 * settings.switch_off_rad_s
    goals = slow * DT * np.cumsum((-1.0) ** (np.arange(300) // 50))
    assert np.abs(compensation(settings, goals)).max() == 0.0


@pytest.mark.parametrize("instrument", ["pretensioned", "thesis"])
def test_an_axis_with_a_target_at_rest_oscillates_only_without_the_switch_off(
    instrument: str,
) -> None:
    speeds = (1e-4, CompensationSettings().switch_off_rad_s)
    asked = [
        Experiment(
            scenario="straight",
            controller="pi_hc",
            instrument=instrument,
            vision="truth",
            vary=(f"law.switch_off_rad_s={speed}", "camera.truth_noise_px=1.0", *SHAFT[instrument]),
            force=True,
        )
        for speed in speeds
    ]
    done = zip(speeds, batch.all_of(asked), strict=True)
    moved = {speed: one.record.as_dict()["handle"]["p2p_deg"][0] for speed, one in done}
    # With sign and w = 0.2 it rings by 18 deg to either side; noise alone moves it by 0.4 to 1.0.
    assert moved[1e-4] > 30
    assert moved[CompensationSettings().switch_off_rad_s] < 1.5


def test_a_ramp_takes_its_time_and_holds_when_motion_ends() -> None:
    settings = CompensationSettings(form="ramp", ramp_s=0.4)
    goals = np.concatenate([ramp(0.3), ramp(0.3)[-1] - ramp(0.3, 1.0)])
    side = compensation(settings, goals)
    turned = int(np.argmax(np.diff(side) < 0))
    there = int(np.argmax(side[turned:] <= -HALF + 1e-9))
    assert there * DT == pytest.approx(0.4, abs=2 * DT)  # counted in whole periods
    rest = np.full(200, goals[-1])
    assert compensation(settings, np.concatenate([goals, rest]))[-1] == pytest.approx(-HALF)


def test_noise_below_the_reversal_does_not_reverse_a_play() -> None:
    settings = CompensationSettings(form="play", reversal_rad=0.01)
    goals = ramp(0.3)
    goals[100:] = goals[100] + 0.004 * (-1.0) ** np.arange(len(goals) - 100)
    side = compensation(settings, goals)[101:]
    assert np.ptp(side) <= 0.8 * HALF + 1e-12  # 8 of 20 mrad from edge to edge
