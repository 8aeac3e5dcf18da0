"""What happens in a run: how the board moves and what the camera does, from a TOML file."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from importlib.resources import files
from math import cos, pi, radians, sin
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from endolock.hw.api import ConfigError


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Strokes(_Section):
    """One-sided strokes along a line, s = travel/2 (1 - cos(2 pi t / period))."""

    kind: Literal["strokes"]
    direction_deg: float = 0.0
    """In the picture: 0 right, 90 up [deg]."""
    travel_m: float = Field(ge=0, le=10)
    """Longest distance from the start [m]."""
    period_s: float = Field(ge=0.01, le=1e9)
    """Out and back [s]."""

    def offset(self, t: float) -> tuple[float, float]:
        """Displacement (right, down) at time `t` [m]."""
        s = self.travel_m / 2 * (1 - cos(2 * pi * t / self.period_s))
        angle = radians(self.direction_deg)
        return s * cos(angle), -s * sin(angle)


class Circle(_Section):
    """A circle around the optical axis at rest, clockwise in the picture, starting at its right."""

    kind: Literal["circle"]
    radius_m: float = Field(ge=0, le=10)
    """[m]"""
    period_s: float = Field(ge=0.01, le=1e9)
    """Once around [s]."""

    def offset(self, t: float) -> tuple[float, float]:
        """Displacement (right, down) at time `t` [m]."""
        phase = 2 * pi * t / self.period_s
        return self.radius_m * cos(phase), self.radius_m * sin(phase)


class Board(_Section):
    """Where the board stands before it moves."""

    distance_m: float = Field(default=0.12, gt=0.005, lt=1.5)
    """Depth ahead of the tip camera at rest [m]. Source: 12 cm, thesis ch. 6."""


class Camera(_Section):
    """Tip camera and video chain."""

    width: int = Field(default=640, ge=16, le=4096)
    """[px]"""
    height: int = Field(default=480, ge=16, le=4096)
    """[px]"""
    fovy_deg: float = Field(default=85.0, gt=1, lt=170)
    """Full vertical field of view [deg]. Assumed; f = 262 px at 480 rows."""
    frame_rate_hz: float = Field(default=25.0, gt=0, le=200)
    """Exposures per second [Hz]. Assumed."""
    latency_s: float = Field(default=0.4, ge=0, le=5)
    """Exposure to delivery [s]. Source: 0.4 s loop latency, thesis ch. 7; all of it in the video
    chain: assumed."""
    jitter_s: float = Field(default=0.0, ge=0, le=1)
    """The latency varies evenly by +- this [s]. Assumed."""
    drop_fraction: float = Field(default=0.0, ge=0, lt=1)
    """Share of the frames that never arrive [1]. Assumed."""


class Scenario(_Section):
    """A whole run; every value can be given in a TOML file of the same shape."""

    name: str
    """From the file's name."""
    summary: str = ""
    """One line for people."""
    duration_s: float = Field(default=25.0, gt=0, le=86400)
    """[s]"""
    scored_from_s: float = Field(default=0.0, ge=0)
    """The score leaves out what comes before [s]."""
    shaft_bend_deg: float = Field(default=180.0, ge=-1080, le=1080)
    """Bend of the shaft, all in one plane [deg]. Assumed."""
    board: Board = Board()
    motion: tuple[Annotated[Strokes | Circle, Field(discriminator="kind")], ...] = ()
    """Movements of the board within its plane; they add up."""
    camera: Camera = Camera()

    def offset(self, t: float) -> tuple[float, float]:
        """Displacement of the board (right, down) at time `t` [m]."""
        moves = [motion.offset(t) for motion in self.motion]
        return sum(m[0] for m in moves), sum(m[1] for m in moves)


SECTIONS: dict[str, type[BaseModel]] = {"board": Board, "camera": Camera}
KINDS: dict[str, type[BaseModel]] = {"strokes": Strokes, "circle": Circle}


def names() -> list[str]:
    """Names of the scenarios that come with the package."""
    return sorted(f.name[:-5] for f in _folder().iterdir() if f.name.endswith(".toml"))


def load(source: str | Path, overrides: Mapping[str, Any] | None = None) -> Scenario:
    """Read a scenario.

    Args:
        source: name of one that comes with the package, or a TOML file.
        overrides: values by dotted key, such as {"camera.latency_s": 0.2}; they replace the file's.

    Raises:
        ConfigError: no such scenario, no TOML, an unknown key, or a value out of range.
    """
    text, name = _read(str(source))
    try:
        values: dict[str, Any] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"scenario {source} is not TOML: {error}; correct the file") from None
    if "name" in values:
        raise ConfigError(f"scenario {name}: unknown key name; the file's name is the scenario's")
    for key, value in (overrides or {}).items():
        *sections, last = key.split(".")
        place = values
        for section in sections:
            place = place.setdefault(section, {})
            if not isinstance(place, dict):
                raise ConfigError(f"scenario {source}: {section} is no section; write [{section}]")
        place[last] = value
    try:
        return Scenario.model_validate({**values, "name": name})
    except ValidationError as error:
        raise ConfigError(f"scenario {name}: {_first(error)}") from None


def sources(source: str | Path, overrides: Mapping[str, Any]) -> dict[str, tuple[Any, str]]:
    """Say of every value of a scenario where it comes from.

    Args:
        source: as for `load`.
        overrides: as for `load`.

    Returns:
        For each dotted key its value, and "option", "file" or "default".
    """
    resolved = load(source, overrides)
    text, _ = _read(str(source))
    in_file = _flat(tomllib.loads(text))
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
    """Give every value one dotted key; list items are numbered."""
    items = values.items() if isinstance(values, Mapping) else enumerate(values)
    flat: dict[str, Any] = {}
    for key, value in items:
        inner = isinstance(value, Mapping | list | tuple) and value
        flat |= _flat(value, f"{prefix}{key}.") if inner else {f"{prefix}{key}": value}
    return flat


def _folder() -> Any:
    return files("endolock") / "models" / "scenarios"


def _read(source: str) -> tuple[str, str]:
    if source in names():
        return (_folder() / f"{source}.toml").read_text(encoding="utf-8"), source
    path = Path(source)
    if path.suffix.lower() == ".toml":
        try:
            return path.read_text(encoding="utf-8-sig"), path.stem
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
            raise ConfigError(f"cannot read scenario {source}: {reason}; check the path") from None
    near = get_close_matches(source, names(), 1)
    hint = f"; did you mean {near[0]}?" if near else ""
    raise ConfigError(
        f"scenario '{source}' is unknown; use {', '.join(names())} or a .toml file{hint}"
    )


def _first(error: ValidationError) -> str:
    """The first thing wrong, in one line."""
    problem = error.errors()[0]
    where = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        name, known = str(problem["loc"][-1]), _keys(problem["loc"][:-1])
        elsewhere = {key: f"{part}.{key}" for part in SECTIONS for key in _keys((part,))}
        near = get_close_matches(name, known, 1) or get_close_matches(name, elsewhere, 1)
        if near:
            return f"unknown key {where}; did you mean {elsewhere.get(near[0], near[0])}?"
        return f"unknown key {where}; known are {', '.join(known)}"
    text = problem["msg"].replace("Input should be", "should be")
    got = "" if problem["type"] == "missing" else f", got {problem['input']!r}"
    return f"{where}: {text}{got}"


def _keys(place: tuple[int | str, ...]) -> list[str]:
    """List the keys that may stand at a place of a scenario file."""
    model: type[BaseModel] = Scenario
    for part in place:
        model = {**SECTIONS, **KINDS}.get(str(part), model)
    return [key for key in model.model_fields if key != "name"]
