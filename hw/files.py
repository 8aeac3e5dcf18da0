"""TOML files that come with the package, and files of one's own: reading, and saying what is wrong.

Scenarios and instruments are such files; a folder below `models` holds those of the package.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from endolock.hw.api import ConfigError

_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
"""What pydantic calls an unknown key, in models and in dataclasses."""


class Section(BaseModel):
    """Values of one part of a file: frozen, finite, and none with an unknown name."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def names(folder: str) -> list[str]:
    """Names of the files that come with the package.

    Args:
        folder: where they are, below `models`.
    """
    return sorted(f.name[:-5] for f in _place(folder).iterdir() if f.name.endswith(".toml"))


def read(kind: str, folder: str, source: str) -> tuple[dict[str, Any], str]:
    """Read a file by name or path.

    Args:
        kind: what it holds, for people, such as "scenario".
        folder: where those are that come with the package, below `models`.
        source: name of one of these, or a path ending in .toml.

    Returns:
        What is in it, and its name.

    Raises:
        ConfigError: no such name, no file that can be read, or no TOML.
    """
    text, name = _text(kind, folder, source)
    try:
        return tomllib.loads(text), name
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{kind} {source} is not TOML: {error}", "correct the file") from None


def first_problem(
    error: ValidationError,
    keys: Callable[[tuple[str, ...]], list[str]],
    elsewhere: Mapping[str, str] | None = None,
) -> str:
    """Say the first thing wrong with the values of a file, in one line; unknown keys come first.

    Args:
        error: what pydantic found.
        keys: lists the keys that may stand at a place, such as () or ("camera",).
        elsewhere: keys of other places, and what they are called in full there; one of these is
            proposed for an unknown key that resembles none of its own place, or stands above all
            sections by its very name.
    """
    problem = min(error.errors(), key=lambda found: found["type"] not in _UNKNOWN)
    place = tuple(str(part) for part in problem["loc"])
    where = ".".join(place)
    if problem["type"] in _UNKNOWN:
        *section, name = place
        known, others = keys(place[:-1]), elsewhere or {}
        exact = [others[name]] if name in others and not section else []
        near = [".".join((*section, key)) for key in get_close_matches(name, known, 1)]
        far = [others[key] for key in get_close_matches(name, others, 1)]
        if meant := exact + near + far:
            return f"unknown key {where}; did you mean {meant[0]}?"
        return f"unknown key {where}; known are {', '.join(known)}"
    text = _said(problem, where)
    return f"{where}: {text}" if where else text


def _said(problem: Any, where: str) -> str:
    kind, value = problem["type"], problem["input"]
    if kind == "value_error":  # raised by a check of ours, which says it all
        return str(problem["ctx"]["error"])
    if kind == "missing":
        return str(problem["msg"])
    if kind == "union_tag_not_found":
        return f"{problem['ctx']['discriminator']} is missing"
    if kind == "tuple_type" and isinstance(value, dict):
        return f"there may be several; write [[{where}]]"
    if kind == "model_type" and isinstance(value, list):
        return f"there is one only; write [{where}]"
    return f"{problem['msg'].replace('Input should be', 'should be')}, got {value!r}"


def _place(folder: str) -> Any:
    return resources.files("endolock") / "models" / folder


def _text(kind: str, folder: str, source: str) -> tuple[str, str]:
    known = names(folder)
    if source in known:
        return (_place(folder) / f"{source}.toml").read_text(encoding="utf-8"), source
    path = Path(source)
    if path.suffix.lower() == ".toml":
        try:
            return path.read_text(encoding="utf-8-sig"), path.stem
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
            raise ConfigError(f"cannot read {kind} {source}: {reason}", "check the path") from None
    near = get_close_matches(source, known, 1)
    hint = f"; did you mean {near[0]}?" if near else ""
    raise ConfigError(
        f"{kind} '{source}' is unknown", f"use {', '.join(known)} or a .toml file{hint}"
    )
