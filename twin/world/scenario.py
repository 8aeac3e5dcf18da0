"""Scenarios: what happens in a run, from a TOML file; all parts can be combined.

Motion of board, shaft and occluders, pushes on the tip, settings of camera and pose tracker, and
what changes during the run.
`playback.Course` evaluates them at a given time.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, ValidationError, model_validator

from endolock.hw import files
from endolock.hw.api import ConfigError
from endolock.hw.strict import Strict, bounded, shown
from endolock.twin.world import joint_conditions
from endolock.twin.world.mid_run import Change, VideoGap
from endolock.twin.world.motion import KINDS, BoardMotion
from endolock.twin.world.scenario_sections import (
    Board,
    CameraSettings,
    Light,
    Occluder,
    PoseTrackerSettings,
    Push,
    Shaft,
    ShaftBend,
)

FOLDER = "scenarios"
"""Folder of the package's scenarios, below `models`."""


LONGEST_TEXT = 200
"""Most characters of a name or a summary [1]."""


def _line(text: str) -> str:
    """Return a text that people can read on one line."""
    if len(text) > LONGEST_TEXT or not text.isprintable():
        raise ConfigError(
            f"got {shown(text)}, wanted up to {LONGEST_TEXT} printable characters on one line",
            "use another text",
        )
    return text


def _name(text: str) -> str:
    """Return a text that may be the name of a folder."""
    if not text or "/" in text:
        raise ConfigError(f"got {shown(text)}", "use a name that a folder may have")
    return _line(text)


class Scenario(Strict):
    """All that happens in a run; every value can be given in a TOML file of the same structure."""

    name: Annotated[str, AfterValidator(_name)]
    """Name, from the file name."""
    summary: Annotated[str, AfterValidator(_line)] = ""
    """One line that describes the scenario."""
    duration_s: Annotated[float, bounded(0.02, 86400, "s", hint="give seconds, up to a day")] = 25.0
    """Duration of the run [s]."""
    scored_from_s: Annotated[float, bounded(0, 86400, "s", hint="give seconds")] = 0.0
    """Time from which the run is scored [s]."""
    shaft_bend_deg: ShaftBend = 180.0
    """Bend of the shaft at the start, all in one plane [deg]. Assumed."""
    gravity: bool = False
    """Whether section and tip have weight, downwards in the picture at rest. Assumed: no."""
    board: Board = Board()
    light: Light = Light()
    motion: tuple[BoardMotion, ...] = ()
    """Movements of the board within its plane; they add up."""
    shaft: tuple[Shaft, ...] = ()
    """Changes of the shaft; they add up."""
    push: tuple[Push, ...] = ()
    """Forces on the tip; they add up."""
    occluder: tuple[Occluder, ...] = ()
    """Plates between tip and board."""
    change: tuple[Change, ...] = ()
    """Changes of the video chain and of the wires' friction, in the order in which they start."""
    video_gap: tuple[VideoGap, ...] = ()
    """Times in which no frame arrives."""
    camera: CameraSettings = CameraSettings()
    tracker: PoseTrackerSettings | None = None
    """Pose tracker of the tip; without this section there is none."""

    @property
    def period_s(self) -> float | None:
        """Longest period of the board's motions [s]; None where nothing repeats."""
        periods = [getattr(motion, "period_s", 0.0) for motion in self.motion]
        return max(periods, default=0.0) or None

    @model_validator(mode="after")
    def _can_be(self) -> Self:
        joint_conditions.check(self)
        return self


SECTIONS: dict[str, type[BaseModel]] = {
    "board": Board,
    "light": Light,
    "camera": CameraSettings,
    "tracker": PoseTrackerSettings,
}
LISTS: dict[str, type[BaseModel]] = {
    "shaft": Shaft,
    "push": Push,
    "occluder": Occluder,
    "change": Change,
    "video_gap": VideoGap,
}
"""Tables such as [board], and arrays of tables such as [[shaft]]; for [[motion]] see
`motion.KINDS`."""


def names() -> list[str]:
    """List the scenarios of the package."""
    return files.names(FOLDER)


def load(source: str | Path | Scenario, overrides: Mapping[str, Any] | None = None) -> Scenario:
    """Read a scenario, or change one that is loaded.

    Args:
        source: name of a scenario of the package, path of a TOML file, or a loaded scenario.
        overrides: values by dotted key, such as {"camera.latency_s": 0.2}; they replace its values.

    Raises:
        ConfigError: there is no such scenario, the file is not TOML, a key is unknown, or a value
            is out of range.
    """
    values, name = values_of(source)
    if "name" in values:
        raise ConfigError(
            f"scenario {name}: unknown key name", "the name of a scenario is that of its file"
        )
    for key, value in (overrides or {}).items():
        *sections, last = key.split(".")
        table = values
        for section in sections:
            table = table.setdefault(section, {})
            if isinstance(table, list | tuple):
                raise ConfigError(
                    f"scenario {name}: {section} is a list, and {key} is a part of it",
                    f"give the whole list, {section}=[{{...}}, ...]",
                )
            if not isinstance(table, dict):
                raise ConfigError(
                    f"scenario {name}: {section} is not a section, so there is no {key}",
                    f"give {section} itself",
                )
        table[last] = value
    try:
        made = Scenario.model_validate({**values, "name": name})  # copies are not checked when made
        return source if isinstance(source, Scenario) and not overrides else made
    except ValidationError as error:
        parts = reversed(list(SECTIONS))  # if several sections have a key, the first is proposed
        elsewhere = {key: f"{part}.{key}" for part in parts for key in _keys((part,))}
        what, next_step = files.first_problem(error, _keys, elsewhere)
        raise ConfigError(f"scenario {name}: {what}", next_step) from None


def values_of(source: str | Path | Scenario) -> tuple[dict[str, Any], str]:
    """Return the values of a scenario as they are, and its name.

    Args:
        source: as for `load`.

    Raises:
        ConfigError: there is no such scenario, or the file is not TOML.
    """
    if isinstance(source, Scenario):
        values = source.model_dump(exclude={"name"}, exclude_none=True, warnings=False)
        return values, source.name
    return files.read("scenario", FOLDER, str(source))


def sources(
    source: str | Path | Scenario, overrides: Mapping[str, Any]
) -> dict[str, tuple[Any, str]]:
    """Return the source of each value of a scenario.

    Args:
        source: as for `load`.
        overrides: as for `load`.

    Returns:
        For each dotted key its value, and "option", "file" or "default".
    """
    resolved = load(source, overrides)
    loaded = isinstance(source, Scenario)
    in_file = {} if loaded else _flat(files.read("scenario", FOLDER, str(source))[0])
    found = {}
    for key, value in _flat(resolved.model_dump(exclude={"name"})).items():
        found[key] = (value, "file" if key in in_file else "default")
        if key in overrides:
            found[key] = (value, "option")
    return found


def schema() -> dict[str, Any]:
    """Return the JSON Schema of scenario files, for editors."""
    model = Scenario.model_json_schema()
    del model["properties"]["name"]
    model["required"] = []
    return model


def _flat(values: Any, prefix: str = "") -> dict[str, Any]:
    """Flatten nested values to dotted keys; list items are numbered."""
    items = values.items() if isinstance(values, Mapping) else enumerate(values)
    flat: dict[str, Any] = {}
    for key, value in items:
        inner = isinstance(value, Mapping | list | tuple) and value
        flat |= _flat(value, f"{prefix}{key}.") if inner else {f"{prefix}{key}": value}
    return flat


def _keys(path: tuple[str, ...]) -> list[str]:
    """List the keys that are allowed in a section of a scenario file."""
    model: type[BaseModel] = Scenario
    for part in path:
        model = {**SECTIONS, **LISTS, **KINDS}.get(part, model)
    return [key for key in model.model_fields if key != "name"]
