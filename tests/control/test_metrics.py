"""Scores against closed forms, on runs made by hand."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import nan, sqrt
from typing import Any

import numpy as np
import pytest

from endolock.control import loop, metrics, registry
from endolock.control.loop import Run, Seen, Tick
from endolock.hw.api import Calibration, Frame, Mode, Plant, Pose, State, TruthSample
from endolock.twin.rig import TwinRig
from endolock.vision.observation import Observation, Status
from endolock.vision.truth_eyes import TruthEyes

CAMERA = Calibration(width=640, height=480, focal_px=250.0, centre_px=(319.5, 239.5))
PERIOD_S = 0.02
EXPOSURE_S = 0.02

ROUNDING = 1e-9  # of a few hundred operations on numbers below a thousand

GROUPS = {
    "error_px": {"rms", "p95", "max", "mean", "within_20", "within_50"},
    "startup_error_px": {"rms", "p95", "max", "mean", "within_20", "within_50"},
    "error_deg": {"rms", "max"},
    "delayed_error_px": {"rms", "p95", "max", "mean", "within_20", "within_50"},
    "vision_error_px": {"rms", "max"},
    "handle": {
        *("rate_rms", "accel_rms", "jerk_rms", "travel_rad", "p2p_deg"),
        *("reversals_per_s", "large_reversals_per_s", "fast_share"),
    },
    "tip": {"p2p_deg", "travel_deg"},
}
SINGLE = {"frames", "frames_dropped", "detected_fraction", "lost_fraction", "time_to_lock_s"}
SINGLE |= {"overruns", "blur_px"}
TRUE = {"error_px", "startup_error_px", "error_deg", "vision_error_px", "tip"}

POSE = Pose(t=0.0, position=(0.0, 0.0, 0.0), quaternion=(1.0, 0.0, 0.0, 0.0))
PLANT = Plant(
    bend_rad=(0.0, 0.0),
    tip=POSE,
    board=POSE,
    backbone=np.zeros((2, 3)),
    tension_handle_n=(),
    tension_section_n=(),
)


def truth(right_px: float, down_px: float = 0.0, error_deg: float = 0.0) -> TruthSample:
    """Put the target at this distance from the image centre."""
    u, v = CAMERA.centre_px
    return TruthSample(
        t=0.0,
        target_px=(u + right_px, v + down_px),
        in_picture=True,
        hidden=False,
        distance_m=0.12,
        error_deg=error_deg,
        plant=PLANT,
    )


def tick(
    t: float,
    sample: TruthSample | None = None,
    position: tuple[float, float] = (0.0, 0.0),
    velocity: tuple[float, float] = (0.0, 0.0),
    status: Status = Status.TRACKING,
) -> Tick:
    state = State(
        t=t,
        t_err=0.0,
        seq=0,
        position=position,
        velocity=velocity,
        current=(0.0, 0.0),
        goal=position,
        clipped=(0, 0),
        fresh=True,
        mode=Mode.ENABLED,
        device_tick=0,
    )
    return Tick(
        t=t, skipped=0, command=None, state=state, status=status, tracked=None, truth=sample
    )


def frame(
    t: float, right_px: float, sample: TruthSample | None, status: Status = Status.TRACKING
) -> Seen:
    u, v = CAMERA.centre_px
    pixel = (u + right_px, v) if status is Status.TRACKING else (nan, nan)
    return Seen(
        frame=Frame(image=None, t_capture=t - 0.4, t_available=t, seq=0, dropped=1),
        observation=Observation(t_capture=t - 0.4, seq=0, status=status, target_px=pixel),
        overview=None,
        truth=sample,
    )


def score(ticks: Sequence[Tick], seen: Sequence[Seen] = (), from_s: float = 0.0) -> dict[str, Any]:
    run = Run(ticks=list(ticks), seen=list(seen))
    return metrics.score(run, CAMERA, from_s, EXPOSURE_S).as_dict()


def errors(*px: float, start_s: float = 0.0) -> list[Tick]:
    """Make ticks with these errors."""
    return [tick(start_s + n * PERIOD_S, truth(e)) for n, e in enumerate(px)]


def turning(rate: Callable[[float], tuple[float, float]]) -> dict[str, float]:
    """Score the handles over a second at a given speed."""
    times = [n * PERIOD_S for n in range(51)]
    return dict(score([tick(t, velocity=rate(t)) for t in times])["handle"])


def placed(position: Callable[[float], float], duration_s: float) -> dict[str, float]:
    """Score the handles, of which up_down stands still."""
    times = [n * PERIOD_S for n in range(round(duration_s / PERIOD_S) + 1)]
    return dict(score([tick(t, position=(0.0, position(t))) for t in times])["handle"])


@pytest.mark.parametrize("known", [True, False])
def test_every_score_has_its_key(known: bool) -> None:
    sample = truth(5.0) if known else None
    ticks = [tick(n * PERIOD_S, sample) for n in range(200)]
    result = score(ticks, [frame(1.0, 5.0, sample)], 0.5)
    assert set(result) == SINGLE | set(GROUPS)
    unknown = set() if known else TRUE
    assert {name for name in GROUPS if result[name] is None} == unknown
    found = {name: set(result[name]) for name in GROUPS if name not in unknown}
    assert found == {name: keys for name, keys in GROUPS.items() if name not in unknown}
    values = [result[name] for name in SINGLE]
    values += [value for name in found for value in result[name].values()]
    assert (None not in values) is known
    json.dumps(result, allow_nan=False)  # plain numbers


def test_a_constant_error() -> None:
    result = score([tick(n * PERIOD_S, truth(18.0, -24.0, 6.8)) for n in range(100)])
    assert result["error_px"] == pytest.approx(
        {"rms": 30, "p95": 30, "max": 30, "mean": 30, "within_20": 0, "within_50": 1}
    )
    assert result["error_deg"] == pytest.approx({"rms": 6.8, "max": 6.8})
    assert result["blur_px"] == 0.0


def test_percentiles_and_shares() -> None:
    result = score(errors(*range(100, -1, -1)))["error_px"]
    rms = sqrt(100 * 101 * 201 / 6 / 101)  # from the sum of squares up to 100
    shares = {"within_20": 21 / 101, "within_50": 51 / 101}  # 0 to 20 are 21
    expected = {"rms": rms, "p95": 95, "max": 100, "mean": 50, **shares}
    assert result == pytest.approx(expected, abs=ROUNDING)


def test_a_target_behind_the_camera_counts_as_far_away() -> None:
    result = score([*errors(0, 0, 0), tick(1.0, truth(nan, nan, 180.0))])
    assert result["error_px"]["max"] == metrics.BEHIND_PX
    assert result["error_px"]["within_50"] == 0.75
    assert result["error_deg"]["max"] == 180.0
    json.dumps(result, allow_nan=False)


@pytest.mark.parametrize(
    ("px", "locked_s"),
    [
        ([50.0] * 50 + [19.0] * 101, 1.0),
        ([50.0] * 50 + [19.0] * 101 + [50.0] * 50, 1.0),  # what was lost later had been locked
        ([50.0] * 50 + [19.0] * 50 + [50.0] * 50 + [19.0] * 101, 3.0),  # 1 s is no lock
        ([19.0] * 101, 0.0),
        ([19.0] * 100, None),  # 1.98 s
        ([20.0] * 500, None),  # not below the bound
        ([19.0] * 50 + [nan] + [19.0] * 101, 1.02),  # behind the camera for one tick
    ],
)
def test_time_to_lock(px: list[float], locked_s: float | None) -> None:
    got = score(errors(*px, start_s=7.0), from_s=9.0)["time_to_lock_s"]
    # Counted from the first tick, and over all of them.
    assert got is None if locked_s is None else got == pytest.approx(locked_s, abs=ROUNDING)


def test_the_start_up_is_scored_apart() -> None:
    ticks = errors(*([30.0] * 50 + [2.0] * 50), start_s=7.0)
    result = score(ticks, from_s=1.0)
    assert result["startup_error_px"]["rms"] == result["startup_error_px"]["max"] == 30.0
    assert result["error_px"]["max"] == 2.0
    assert set(score(ticks)["startup_error_px"].values()) == {None}  # all of it is scored


def test_without_truth_only_the_delayed_error_is_scored() -> None:
    ticks = [tick(n * PERIOD_S) for n in range(200)]
    result = score(ticks, [frame(n * 0.04, 40.0, None) for n in range(100)])
    for name in TRUE:
        assert result[name] is None
    assert result["time_to_lock_s"] is None
    assert result["blur_px"] is None
    assert result["delayed_error_px"] == pytest.approx(
        {"rms": 40, "p95": 40, "max": 40, "mean": 40, "within_20": 0, "within_50": 1}
    )


def test_an_empty_run_has_no_scores() -> None:
    result = score([])
    counts = {"overruns", "frames", "frames_dropped"}
    assert {result[name] for name in counts} == {0}
    for name in SINGLE - counts:
        assert result[name] is None
    for name in GROUPS:
        assert set(result[name].values()) == {None}


def test_late_ticks_are_counted() -> None:
    ticks = [replace(tick(n * PERIOD_S), skipped=n % 3) for n in range(7)]
    assert score(ticks)["overruns"] == 6


def test_ticks_before_the_start_are_not_scored() -> None:
    ticks = errors(*[100.0] * 50, *[10.0] * 51)
    late = [(0.5, 100.0), (0.98, 100.0), (1.0, 12.0), (1.5, 11.0)]  # by the time of delivery
    seen = [frame(t, px, truth(0.0)) for t, px in late]
    result = score(ticks, [frame(0.4, nan, None, Status.SEARCHING), *seen], from_s=1.0)
    assert result["error_px"]["max"] == pytest.approx(10)
    assert result["delayed_error_px"]["max"] == pytest.approx(12)
    assert result["vision_error_px"]["max"] == pytest.approx(12)
    assert (result["frames"], result["detected_fraction"]) == (5, 0.8)  # of all that came


def test_frames_are_counted() -> None:
    seen = [frame(0.1 * n, 0.0, None) for n in range(6)]
    seen += [frame(0.6, 0.0, None, Status.COASTING), frame(0.7, 0.0, None, Status.LOST)]
    lost = [Status.TRACKING] * 3 + [Status.SEARCHING, Status.COASTING] + [Status.LOST] * 5
    result = score([tick(n * PERIOD_S, status=s) for n, s in enumerate(lost)], seen)
    assert (result["frames"], result["frames_dropped"]) == (8, 8)  # one before each
    assert result["detected_fraction"] == 0.75
    assert result["lost_fraction"] == 0.5
    assert result["delayed_error_px"]["max"] == 0.0  # of those that were accepted


def test_vision_is_compared_with_the_truth_at_the_exposure() -> None:
    seen = [frame(0.4, 12.0, truth(9.0)), frame(0.5, 12.0, truth(12.0, -4.0))]
    seen.append(frame(0.6, 0.0, truth(300.0), Status.COASTING))  # nothing to compare
    assert score([], seen)["vision_error_px"] == pytest.approx({"rms": sqrt(12.5), "max": 4.0})


def test_speed_acceleration_and_jerk_of_both_handles_together() -> None:
    uniform = turning(lambda t: (-0.3, 0.4))
    assert uniform["rate_rms"] == pytest.approx(0.5)
    assert uniform["accel_rms"] == uniform["jerk_rms"] == 0.0
    speeding = turning(lambda t: (3 * t, -4 * t))
    assert speeding["accel_rms"] == pytest.approx(5.0)
    assert speeding["jerk_rms"] == pytest.approx(0.0, abs=ROUNDING)
    # Second differences of a parabola are exact.
    assert turning(lambda t: (3 * t**2 / 2, -2 * t**2))["jerk_rms"] == pytest.approx(5.0)


@pytest.mark.parametrize("drift", [0.0, 0.03, -0.08])
def test_a_triangle_wave_reverses_twice_per_period(drift: float) -> None:
    # Up 50 mrad and down again; a drift slower than the wave changes neither turns nor travel.
    handle = placed(lambda t: 0.1 * abs((t + 0.5) % 1.0 - 0.5) + drift * t, 4.0)
    assert handle["reversals_per_s"] == pytest.approx(7 / 4)  # at 0.5, 1, ... 3.5 s
    assert handle["travel_rad"] == pytest.approx(8 * 0.05)


def test_a_ripple_below_the_resolution_is_not_a_reversal() -> None:
    small, large = 0.9 * metrics.REVERSAL_RAD, 1.1 * metrics.REVERSAL_RAD
    assert placed(lambda t: small * (round(t / PERIOD_S) % 2), 4.0)["reversals_per_s"] == 0.0
    # One sign change a tick, but for the first, which sets the direction.
    shaking = placed(lambda t: large * (round(t / PERIOD_S) % 2), 4.0)["reversals_per_s"]
    assert shaking == pytest.approx(199 / 4)


def test_large_reversals_are_those_that_a_person_sees() -> None:
    """A slow wave of 0.3 rad with a ripple of 20 mrad on it."""
    handle = placed(
        lambda t: 0.6 * abs((t / 2 + 0.5) % 1.0 - 0.5) + 0.02 * (round(t / PERIOD_S) % 2), 8.0
    )
    assert handle["large_reversals_per_s"] == pytest.approx(7 / 8)  # at 1, 2, ... 7 s
    assert handle["reversals_per_s"] > 40  # the ripple turns at nearly every tick


@pytest.mark.parametrize(("size", "count"), [(0.99, 0.0), (1.01, 3 / 4)])
def test_a_tenth_of_a_radian_is_a_large_reversal(size: float, count: float) -> None:
    """A triangle wave turns at 1, 2 and 3 s; the start sets the direction."""
    top = size * metrics.LARGE_REVERSAL_RAD
    wave = placed(lambda t: top * abs((t / 2 + 0.5) % 1.0 - 0.5) * 2, 4.0)
    assert wave["large_reversals_per_s"] == pytest.approx(count)


def test_the_fast_share_is_of_both_handles_together() -> None:
    """A handle at 1.5 rad/s throughout, the other one too for a quarter of the time: 2.12."""
    mixed = turning(lambda t: (1.5, -1.5 if t < 0.25 else 0.0))
    assert mixed["fast_share"] == pytest.approx(0.25, abs=0.02)  # a tick of 51
    assert turning(lambda t: (1.9, 0.0))["fast_share"] == 0.0
    assert turning(lambda t: (0.0, -2.1))["fast_share"] == 1.0


def test_motion_of_tip_and_handles_on_each_axis() -> None:
    swing = [np.radians(30 * n / 50 if n <= 50 else 30 - 24 * (n - 50) / 50) for n in range(101)]
    ticks = []
    for n, angle in enumerate(swing):
        plant = replace(PLANT, bend_rad=(angle, -angle / 2))
        sample = replace(truth(0.0), plant=plant)
        ticks.append(tick(n * PERIOD_S, sample, position=(0.0, 2 * angle)))
    result = score(ticks)
    assert result["tip"]["p2p_deg"] == pytest.approx([30, 15])
    assert result["tip"]["travel_deg"] == pytest.approx([54, 27])  # 30 there, 24 back
    assert result["handle"]["p2p_deg"] == pytest.approx([0, 60])
    assert score(ticks, from_s=1.0)["tip"]["p2p_deg"] == pytest.approx([24, 12])  # scored part


def test_blur_is_the_motion_during_an_exposure() -> None:
    ticks = [tick(n * PERIOD_S, truth(60 * n * PERIOD_S, 80 * n * PERIOD_S)) for n in range(100)]
    run = Run(ticks=ticks, seen=[])
    for exposure_s in (0.0, 0.004, 0.03):
        blur = metrics.score(run, CAMERA, 0.0, exposure_s).blur_px
        assert blur == pytest.approx(100 * exposure_s)  # at 100 px/s
    assert metrics.score(run, CAMERA, 0.0).blur_px is None  # the exposure is not known


def test_a_run_that_is_not_kept_scores_the_same() -> None:
    runs, scores = [], []
    for keep in (True, False):
        with TwinRig("circle", pictures=False) as rig:
            camera = rig.camera.calibration
            scorer = metrics.Scorer(camera, 0.4)
            eyes, law = TruthEyes(rig.truth), registry.make("pi", camera)
            runs.append(loop.run(rig, eyes, law, duration_s=1.0, recorder=scorer, keep=keep))
            scores.append(scorer.scores())
    assert runs[1] == Run()
    assert len(runs[0].ticks) == 51
    assert scores[0] == scores[1] == metrics.score(runs[0], camera, 0.4)
    assert scores[0].error_px is not None
    assert scores[0].error_px.rms is not None
