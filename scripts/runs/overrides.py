"""Changes of a scenario, an instrument and a controller: KEY=VALUE options, and files.

A variation is written KEY=VALUE, with a key of the scenario file such as camera.jitter_s, or with
instrument.NAME, law.NAME or numerics.NAME; or it is the name of a disturbance, or a TOML file of
this form:

    summary = "one line for people"
    [scenario]          # replaces values; lists such as [[scenario.motion]] are extended
    [instrument]        # replaces values
    [instrument_times]  # multiplies values
"""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import Field, ValidationError

from endolock.hw import files
from endolock.hw.api import ConfigError
from endolock.hw.errors import did_you_mean
from endolock.hw.strict import Strict, shown
from endolock.twin.world import instrument_files, joint_conditions, scenario
from endolock.twin.world.instrument import Instrument, Numerics
from endolock.twin.world.scenario import Scenario

FOLDER = "disturbances"
"""Folder of the disturbances that come with the package, below `models`."""


class Variation(Strict):
    """Changes, by what they apply to."""

    summary: str = ""
    scenario: dict[str, Any] = Field(default_factory=dict)
    instrument: dict[str, float] = Field(default_factory=dict)
    instrument_times: dict[str, float] = Field(default_factory=dict)
    law: dict[str, Any] = Field(default_factory=dict)
    numerics: dict[str, Any] = Field(default_factory=dict)


class Task(NamedTuple):
    """Scenario and instrument with all changes applied, and the changes."""

    scenario: Scenario
    instrument: Instrument
    law: dict[str, Any]
    """Changed parameters of the controller, by name."""
    changes: dict[str, Any]
    """Changed values of the scenario, by dotted key."""
    numerics: Numerics
    plain: Scenario
    """The scenario without the changes; with them where it is not possible without."""


def names() -> list[str]:
    """Names of the disturbances that come with the package."""
    return files.names(FOLDER)


def read(entry: str) -> Variation:
    """Read one KEY=VALUE, or one disturbance by name or file.

    Raises:
        ConfigError: it is neither, or has an unknown section.
    """
    if "=" not in entry:
        values, name = files.read("disturbance", FOLDER, entry)
        return _variation(values, f"disturbance {name}: ")
    key, _, text = entry.partition("=")
    section, _, rest = key.partition(".")
    value = _value(text)
    if section in ("instrument", "law", "numerics") and rest:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if section == "instrument" and not number:
            raise ConfigError(f"{key}: {shown(text)} is not a number", "give one in SI units")
        return _variation({section: {rest: value}}, "")
    return Variation(scenario={key: value})


def _variation(values: Mapping[str, Any], where: str) -> Variation:
    try:
        return Variation.model_validate(values)
    except ValidationError as error:
        known = list(Variation.model_fields)
        what, next_step = files.first_problem(error, lambda path: [] if path else known)
        raise ConfigError(f"{where}{what}", next_step) from None


def expand(entry: str) -> list[str]:
    """Split KEY=A,B into KEY=A and KEY=B; anything else is one entry."""
    key, is_value, text = entry.partition("=")
    if not is_value or text.startswith(("[", "{", '"')):
        return [entry]
    return [f"{key}={part}" for part in text.split(",")]


def apply(
    source: str | Path | Scenario,
    instrument: str | Path | Instrument,
    entries: Sequence[str],
    options: Mapping[str, Any] | None = None,
) -> Task:
    """Apply variations one after another.

    Args:
        source: the scenario: its name, its file, or an object.
        instrument: the instrument: its name, its file, or an object.
        entries: the variations, as for `read`.
        options: further values of the scenario by dotted key; they take precedence.

    Raises:
        ConfigError: one cannot be read or does not fit.
    """
    changes: dict[str, Any] = {}
    law: dict[str, Any] = {}
    numerics = Numerics()
    instrument = instrument_files.load(instrument)
    lists = scenario.values_of(source)[0]
    for entry in entries:
        variation = read(entry)
        for key, value in flat(variation.scenario).items():
            extends = "=" not in entry and isinstance(value, list)
            if extends and value and isinstance(value[0], dict):
                before = changes.get(key, lists.get(key, []))
                value = [*(before if isinstance(before, list | tuple) else [before]), *value]
            changes[key] = value
        instrument = _changed(instrument, variation)
        numerics = _refined(numerics, variation.numerics)
        law |= variation.law
    changes |= options or {}
    loaded = scenario.load(source, changes)
    joint_conditions.check_shaft(loaded, instrument)
    plain = loaded
    with suppress(ConfigError):  # some are possible with their changes only
        plain = scenario.load(source)
    return Task(loaded, instrument, law, changes, numerics, plain)


def changed_keys(entry: str) -> Iterator[tuple[str, Any]]:
    """Yield each key that a variation changes, such as camera.noise or law.ki, and its value.

    Raises:
        ConfigError: as for `read`.
    """
    variation = read(entry)
    yield from flat(variation.scenario).items()
    for name in ("instrument", "law", "numerics"):
        yield from flat({name: getattr(variation, name)}).items()
    for name, factor in variation.instrument_times.items():
        yield f"instrument.{name}", factor


def _refined(numerics: Numerics, values: Mapping[str, float]) -> Numerics:
    known = dataclasses.asdict(numerics)
    for name in values:
        if name not in known:
            hint = did_you_mean(name, known, "numerics.")
            raise ConfigError(f"numerics have no {name}", f"they have {', '.join(known)}{hint}")
    return Numerics(**known | dict(values))


def _changed(instrument: Instrument, variation: Variation) -> Instrument:
    values = dataclasses.asdict(instrument)
    for name in (*variation.instrument, *variation.instrument_times):
        if name not in values:
            near = [key for key in values if name in key] or get_close_matches(name, values, 1)
            hint = f"did you mean instrument.{near[0]}?" if near else f"it has {', '.join(values)}"
            raise ConfigError(f"an instrument has no {name}", hint)
    values |= variation.instrument
    times = variation.instrument_times
    return Instrument(
        **{name: v * times[name] if name in times else v for name, v in values.items()}
    )


def flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Flatten nested tables to dotted keys; lists stay as they are."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        nested = isinstance(value, Mapping)
        found |= flat(value, f"{prefix}{key}.") if nested else {f"{prefix}{key}": value}
    return found


def _value(text: str) -> Any:
    """Read a TOML value, or a number such as .5; anything else is taken as text."""
    try:
        read = tomllib.loads(f"value = {text}")
        if len(read) == 1:  # no further lines
            return read["value"]
    except (ValueError, RecursionError):
        with suppress(ValueError):
            return float(text)
    return text


def label(entries: Sequence[str]) -> str:
    """Name a set of variations for tables and folders."""
    return "+".join(Path(entry).stem if entry.endswith(".toml") else entry for entry in entries)
