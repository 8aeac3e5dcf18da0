"""`endolock latency` on the twin: accuracy of 5 ms, bad input."""

import json

import pytest

from endolock.scripts import cli


@pytest.mark.parametrize("latency_s", [pytest.param(0.1, marks=pytest.mark.slow), 0.33])
def test_the_latency_is_found_within_5_ms(
    latency_s: float, capsys: pytest.CaptureFixture[str]
) -> None:
    args = ["latency", "--latency-s", str(latency_s), "--strokes", "4", "--json", "-"]
    assert cli.main(args) == 0
    record = json.loads(capsys.readouterr().out)
    # the requirement; 4-5 ms is the lag of the tip behind the encoder, always positive
    assert 0 <= record["latency_s"] - latency_s <= 0.005
    assert record["frame_rate_hz"] == pytest.approx(25.0, rel=1e-6)  # without jitter, only rounding
    assert record["jitter_s"] < 1e-6
    low, high = record["ci95_s"]
    assert low <= record["latency_s"] <= high
    assert record["vision_ms"] > 0


@pytest.mark.parametrize(
    ("args", "why"),
    [
        (["--axis", "roll"], "axis 'roll' is unknown; use up_down or left_right"),
        (["--strokes", "2"], "strokes 2: an interval needs 4 or more"),
        (["--rig", "car"], "rig 'car' is unknown"),
    ],
)
def test_bad_input_gives_one_line(
    args: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["latency", *args]) == 2
    said = capsys.readouterr().err
    assert why in said
    assert said.count("\n") == 1
