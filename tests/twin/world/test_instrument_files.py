"""Instrument files: their values, the errors of wrong ones, and writing without loss."""

import tomllib
from dataclasses import asdict, fields
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from endolock.hw.api import ConfigError
from endolock.twin.world import instrument_files
from endolock.twin.world.instrument import Instrument


def test_pretensioned_is_the_default() -> None:
    assert instrument_files.load("pretensioned") == Instrument()


def test_the_two_regions_end_where_the_default_is() -> None:
    two = instrument_files.load("two_region")
    assert two.slack_at(0.0) > 0
    # the loss is written with 14 digits
    assert two.slack_at(-3.141592653589793) == pytest.approx(Instrument().slack_m, rel=1e-9)


@given(pull_n=st.floats(-50.0, 2000.0), stiffness=st.floats(1.0, 5e6))
def test_an_instrument_is_unchanged_by_writing_and_reading(
    tmp_path_factory: pytest.TempPathFactory, pull_n: float, stiffness: float
) -> None:
    slack_m = min(max(-0.99 * pull_n / stiffness, -0.05), 0.05)
    instrument = Instrument(slack_m=slack_m, wire_stiffness=stiffness)
    file = tmp_path_factory.mktemp("instrument") / "mine.toml"
    file.write_text(instrument_files.dump(instrument, "Mine.\n\nAll of it."), encoding="utf-8")
    assert instrument_files.load(file) == instrument


def test_a_written_file_explains_every_value() -> None:
    text = instrument_files.dump(Instrument(), "Mine.")
    for field, entry in zip(fields(Instrument), instrument_files.meanings().items(), strict=True):
        name, meaning = entry
        assert name == field.name
        assert "[" in meaning, f"{name} has no unit"
        assert "ssumed" in meaning or "Literature" in meaning or "Data sheet" in meaning, name
    assert tomllib.loads(text) == asdict(Instrument())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "conduit_frction = 1",
            "instrument mine: unknown key conduit_frction; did you mean cond",
        ),
        (
            "conduit_friction = -1",
            "instrument: conduit_friction: got -1, wanted 0 to 2, in .*mine.toml; give a number",
        ),
        ("wire_stiffness = 0", "got 0 N/m, wanted 1 to 5000000 N/m, in .*mine.toml; give"),
        ("wire_stiffness = 'much'", "wire_stiffness: should be a valid number, got 'much', in"),
        ("wire_stiffness = true", "wire_stiffness: should be a valid number, got true, in"),
        ("slack_m = nan", "slack_m: should be a finite number, got nan, in .*mine.toml"),
        ("bending_length_m = 75", "bending_length_m: got 75 m, wanted 0.005 to 0.5 m, in"),
        ("calibration = 3", "unknown key calibration; known are bending_length_m"),
        ("[slack_m]\nx = 1", "slack_m: should be a valid number, got {'x': 1}"),
        ("slack_m =", "instrument .*mine.toml is not TOML"),
    ],
)
def test_a_bad_file_is_refused(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        instrument_files.load(file)
    assert "\n" not in str(caught.value)


def test_what_is_wrong_and_what_to_do_stay_apart(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("wire_stiffness = 0")
    with pytest.raises(ConfigError) as caught:
        instrument_files.load(file)
    assert caught.value.next_step == "give a number in this range, in N/m"


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"'slak' is unknown; .* did you mean slack"):
        instrument_files.load("slak")
