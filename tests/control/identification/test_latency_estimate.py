"""The latency estimator on made-up motions whose delay is known."""

import numpy as np
import pytest

from endolock.control.identification import latency_estimate
from endolock.hw.api import Vector
from endolock.scripts.runs.latency_measurement import LEAD_S, STROKE_S, stroke_angle

T = np.arange(0.0, LEAD_S + 8 * STROKE_S + latency_estimate.LONGEST_S, 0.02)
HANDLE = np.array([stroke_angle(t, 8) for t in T])


@pytest.mark.parametrize("true", [0.0, 0.1, 0.333, 0.8, 1.2])
def test_a_pure_delay_is_found(true: float) -> None:
    found = _measured(true)
    # handle angles every 20 ms are joined by lines: half a millisecond
    assert found.latency_s == pytest.approx(true, abs=0.001)
    assert found.correlation > 0.999
    assert found.frame_rate_hz == pytest.approx(25.0)
    assert found.jitter_s == pytest.approx(0.0, abs=1e-9)  # rounding


def test_play_and_a_changing_gain_do_not_count_as_delay() -> None:
    """A play of 0.6 rad, and a tip that moves more the farther it is bent."""
    tip = np.zeros_like(HANDLE)
    for n in range(1, len(tip)):
        tip[n] = np.clip(tip[n - 1], HANDLE[n] - 0.3, HANDLE[n] + 0.3)
    found = _measured(0.4, tip * (1 + 0.2 * tip))
    assert found.latency_s == pytest.approx(0.4, abs=0.003)  # the gain changes within a stroke


def test_noise_and_jitter_are_estimated() -> None:
    found = _measured(0.4, noise_rad=0.002, jitter_s=0.015)
    low, high = found.ci95_s
    assert high - low > 0.002  # not surer than it can be
    assert found.latency_s == pytest.approx(0.4, abs=0.015)  # one jitter; 200 frames average it
    assert found.jitter_s == pytest.approx(0.015 / np.sqrt(3), rel=0.15)  # even, of 1000 frames


def test_pictures_that_do_not_move_with_the_handle_are_refused() -> None:
    random = np.random.default_rng(0)
    delivered = np.arange(0.0, T[-1], 0.04)
    found = latency_estimate.measure(
        latency_estimate.strokes(T, HANDLE),
        delivered,
        np.arange(float(len(delivered))),
        random.normal(0, 0.01, len(delivered) - 1),
    )
    assert isinstance(found, str)
    assert "do not move together" in found
    assert "still object" in found  # what to do


def test_a_handle_at_rest_is_refused() -> None:
    delivered = np.arange(0.0, T[-1], 0.04)
    found = latency_estimate.measure(
        latency_estimate.strokes(T, np.zeros_like(T)),
        delivered,
        np.arange(float(len(delivered))),
        np.zeros(len(delivered) - 1),
    )
    assert isinstance(found, str)
    assert "made no steady stroke" in found


def test_the_handle_never_reverses_within_a_stroke() -> None:
    fine = np.arange(LEAD_S, LEAD_S + STROKE_S, 0.001)
    way = np.array([stroke_angle(t, 8) for t in fine])
    assert (np.diff(way) > 0).all()
    assert stroke_angle(LEAD_S + 1.5 * STROKE_S, 8) == pytest.approx(
        -stroke_angle(LEAD_S + STROKE_S / 2, 8)
    )


def _measured(
    true: float, tip: Vector | None = None, *, noise_rad: float = 0.0, jitter_s: float = 0.0
) -> latency_estimate.Latency:
    """Frames at 25 Hz of a tip that follows the handle."""
    random = np.random.default_rng(1)
    tip = HANDLE if tip is None else tip
    seq = np.arange(float(int((T[-1] - true) * 25)))
    exposed = seq / 25
    delivered = exposed + true + random.uniform(-jitter_s, jitter_s, len(seq))
    seen = np.interp(exposed, T, tip)
    rotation = np.diff(seen) + random.normal(0, 1, len(seq) - 1) * noise_rad
    found = latency_estimate.measure(latency_estimate.strokes(T, HANDLE), delivered, seq, rotation)
    assert not isinstance(found, str), found
    return found
