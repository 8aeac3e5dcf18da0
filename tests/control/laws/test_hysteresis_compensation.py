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


def course(settings: CompensationSettings, wanted: np.ndarray) -> np.ndarray:
    """Compensation along a course of what a law wants."""
    direction, out = Direction(), []
    direction.behind = float(wanted[0])
    for before, now in zip([wanted[0], *wanted[:-1]], wanted, strict=True):
        out.append(follow(settings, direction, float(before), float(now), DT))
    return np.array(out)


def ramp(speed: float, seconds: float = 3.0) -> np.ndarray:
    return speed * np.arange(0.0, seconds, DT)


@pytest.mark.parametrize("form", ["sign", "play", "ramp"])
@pytest.mark.parametrize("speed", [0.3, -0.3])
def test_in_steady_motion_it_is_half_the_width(form: str, speed: float) -> None:
    settings = CompensationSettings(form=form)  # type: ignore[arg-type]
    assert course(settings, ramp(speed))[-1] == pytest.approx(np.sign(speed) * HALF, rel=1e-9)


def test_smooth_follows_the_speed() -> None:
    settings = CompensationSettings(form="smooth", smooth_rad_s=0.1)
    expected = HALF * tanh(0.05 / 0.1)
    # 3 s are 37 time constants of the speed's low-pass
    assert course(settings, ramp(0.05))[-1] == pytest.approx(expected, rel=1e-6)


def test_a_play_of_that_width_is_followed_exactly_both_ways() -> None:
    wanted = np.concatenate([ramp(0.3), ramp(0.3)[-1] - ramp(0.3)])
    handle = wanted + course(CompensationSettings(form="sign"), wanted)
    tip = play(handle, HALF)
    settled = np.r_[20 : len(wanted) // 2, len(wanted) // 2 + 20 : len(wanted)]
    assert tip[settled] == pytest.approx(wanted[settled], abs=1e-12)  # roundings only


def test_switched_off_early_there_is_none_at_low_speed() -> None:
    settings = CompensationSettings(form="sign", switch_off_rad_s=0.1)
    assert course(settings, ramp(0.05))[-1] == 0.0
    assert course(settings, ramp(0.3))[-1] == pytest.approx(HALF)


def test_a_speed_near_the_switch_off_does_not_switch_it_to_and_fro() -> None:
    """Frames come in steps, so the speed has a ripple: here 30 %."""
    settings = CompensationSettings(form="sign")
    speeds = settings.switch_off_rad_s * (1 + 0.3 * (-1.0) ** np.arange(300))
    for start in (0.0, 0.3):  # from rest, and from a quick motion
        wanted = np.cumsum(DT * np.concatenate([np.full(50, start), speeds]))
        side = np.sign(course(settings, wanted))[50:]
        assert np.count_nonzero(np.diff(side)) <= 1


@pytest.mark.parametrize("form", ["sign", "ramp"])
def test_what_is_slower_than_the_switch_off_rests(form: str) -> None:
    """No sign is taken from noise: with sign there is none, a ramp stays where it was."""
    settings = CompensationSettings(form=form)  # type: ignore[arg-type]
    slow = 0.9 * settings.switch_off_rad_s
    wanted = slow * DT * np.cumsum((-1.0) ** (np.arange(300) // 50))
    assert np.abs(course(settings, wanted)).max() == 0.0


@pytest.mark.parametrize("instrument", ["pretensioned", "thesis"])
def test_an_axis_without_target_motion_rests_and_rings_only_without_the_switch_off(
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


def test_a_ramp_takes_its_time_and_stays_where_motion_ends() -> None:
    settings = CompensationSettings(form="ramp", ramp_s=0.4)
    wanted = np.concatenate([ramp(0.3), ramp(0.3)[-1] - ramp(0.3, 1.0)])
    side = course(settings, wanted)
    turned = int(np.argmax(np.diff(side) < 0))
    there = int(np.argmax(side[turned:] <= -HALF + 1e-9))
    assert there * DT == pytest.approx(0.4, abs=2 * DT)  # counted in whole periods
    rest = np.full(200, wanted[-1])
    assert course(settings, np.concatenate([wanted, rest]))[-1] == pytest.approx(-HALF)


def test_noise_smaller_than_the_reversal_does_not_switch_a_play() -> None:
    settings = CompensationSettings(form="play", reversal_rad=0.01)
    wanted = ramp(0.3)
    wanted[100:] = wanted[100] + 0.004 * (-1.0) ** np.arange(len(wanted) - 100)
    side = course(settings, wanted)[101:]
    assert np.ptp(side) <= 0.8 * HALF + 1e-12  # 8 of 20 mrad from edge to edge
