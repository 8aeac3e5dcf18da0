"""The measurement of hysteresis: figures of the instruments, and the maps."""

from math import degrees
from pathlib import Path
from typing import Any

import pytest

from endolock.scripts.runs import (
    hysteresis_measurement,
    hysteresis_protocol,
    hysteresis_widths,
)
from endolock.scripts.runs.hysteresis_measurement import HysteresisMeasurement
from endolock.scripts.runs.hysteresis_protocol import Protocol
from endolock.twin.world import instrument_files


def _loop(**options: Any) -> dict[str, Any]:
    """Figures of the loop alone, without the one-sided strokes and the drift."""
    found = HysteresisMeasurement(numerics="fast", **options).strokes(whole=False)
    other_axis_deg = degrees(found.other_axis_rad)
    return hysteresis_widths.figures(found.strokes) | {"other_axis_deg": other_axis_deg}


@pytest.mark.parametrize("axis", ["up_down", "left_right"])
def test_the_other_axis_widens_the_loop(axis: Any) -> None:
    alone, beside = (_loop(axis=axis, other_axis_deg=deg) for deg in (0.0, 60.0))
    assert beside["other_axis_deg"] == pytest.approx(60, abs=2)  # reached by turning slowly
    assert beside["width"]["30"] > 1.15 * alone["width"]["30"]


def test_slack_gives_a_deadband_and_friction_gives_none() -> None:
    slack = instrument_files.load("slack")
    right = pytest.approx(2 * slack.slack_m / slack.pulley_radius_m, rel=0.1)
    assert _loop(instrument="slack")["deadband_rad"] == right
    assert _loop(instrument="two_region", shaft_deg=0.0)["deadband_rad"] == right
    assert _loop(instrument="two_region")["deadband_rad"] == 0.0


def test_a_bend_that_remains_at_handle_zero_hides_the_smaller_strokes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(hysteresis_protocol, "DRIFT_S", 1.0)  # not checked here
    record = HysteresisMeasurement(shaft_deg=540.0, numerics="fast").run()
    assert record["width"]["30"] > 0.3  # the loop is still reported
    for ways in record["strokes"].values():
        assert ways["back"]["30"] is None
        assert ways["out"]["30"] is None


def test_half_the_speed_changes_no_width(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = _loop()["width"]
    monkeypatch.setattr(hysteresis_protocol, "SPEED_RAD_S", 0.1)
    slower = _loop()["width"]
    assert usual == pytest.approx(slower, rel=0.02)  # quasi-static; noise of the tracker is 0.5 %


def test_maps_are_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """With few points; a bend that the other axis cannot reach gives a row without figures."""
    monkeypatch.setattr(hysteresis_measurement, "MAP_OTHER_DEG", (0, 40, 170))
    monkeypatch.setattr(hysteresis_measurement, "MAP_SHAFT_DEG", (0, 180))
    monkeypatch.setattr(hysteresis_protocol, "DRIFT_S", 1.0)  # only the loops are looked at here
    monkeypatch.setattr(Protocol, "_one_sided", lambda *_: {})
    record = HysteresisMeasurement(numerics="fast", map=True).run()
    near, beside, beyond = record["map"]["width"]
    assert all(a < b for a, b in zip(near[:5], beside[:5], strict=True))
    assert set(beyond) == {None}
    record["shaft_map"]["deadband_rad"][0] = None  # as if a loop could not be measured
    straight, bent = record["shaft_map"]["width_at_30"]
    assert straight < bent
    from endolock.scripts.figures import hysteresis_figure

    assert hysteresis_figure.draw(record, tmp_path / "maps.png").stat().st_size > 10_000
