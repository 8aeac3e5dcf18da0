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


@given(slack_m=st.floats(-0.01, 0.01), stiffness=st.floats(1.0, 1e6))
def test_an_instrument_is_unchanged_by_writing_and_reading(
    tmp_path_factory: pytest.TempPathFactory, slack_m: float, stiffness: float
) -> None:
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
        ("conduit_friction = -1", "conduit_friction is -1, in .*mine.toml; use zero or more"),
        ("wire_stiffness = 0", "wire_stiffness is 0, in .*mine.toml; use more than zero"),
        ("wire_stiffness = 'much'", "instrument mine: wire_stiffness: should be a valid number"),
        ("slack_m = nan", "slack_m is nan, in .*mine.toml; use a finite number"),
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
    assert caught.value.next_step == "use more than zero"


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"'slak' is unknown; .* did you mean slack"):
        instrument_files.load("slak")
