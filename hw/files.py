"""Files of people: TOML read and judged, and files written whole or not at all.

Scenarios and instruments are TOML files; a folder below `models` holds those of the package.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from endolock.hw.errors import ConfigError, EndolockError, did_you_mean
from endolock.hw.strict import shortened, shown

_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
"""What pydantic calls an unknown key, in models and in dataclasses."""

_TYPES = {
    "float_type": "give a number, without quotes",
    "int_type": "give a whole number, without quotes or decimals",
    "bool_type": "give true or false, without quotes",
    "string_type": "give a text in quotes",
    "finite_number": "give a finite number",
    "tuple_type": "give an array, such as [0.0, 1.0]",
    "literal_error": "use one of these",
    "model_type": "give a table, with a key and a value in each line",
    "model_attributes_type": "give a table, with a key and a value in each line",
}
"""What to do about a value of the wrong type, by what pydantic calls it."""

LARGEST_TOML = 1_000_000
DEEPEST_TOML = 12
"""Longest file [B], and most tables and arrays within each other [1]; ours have 4. Assumed."""


def names(folder: str) -> list[str]:
    """Return the names of the files that come with the package.

    Args:
        folder: where they are, below `models`.
    """
    return sorted(f.name[:-5] for f in _models(folder).iterdir() if f.name.endswith(".toml"))


def read(kind: str, folder: str, source: str) -> tuple[dict[str, Any], str]:
    """Read a file by name or path.

    Args:
        kind: what it holds, for people, such as "scenario".
        folder: where those are that come with the package, below `models`.
        source: name of one of these, or a path ending in .toml.

    Returns:
        Its values, and its name.

    Raises:
        ConfigError: no such name, the file cannot be read, or it is not TOML.
    """
    known = names(folder)
    if source in known:
        text = (_models(folder) / f"{source}.toml").read_text(encoding="utf-8")
        return tomllib.loads(text), source
    path = Path(source)
    if path.suffix.lower() == ".toml":
        return read_toml(path, kind, "check the path"), path.stem
    hint = did_you_mean(source, known)
    raise ConfigError(
        f"{kind} '{source}' is unknown", f"use {', '.join(known)} or a .toml file{hint}"
    )


def read_toml(path: Path, kind: str, next_step: str) -> dict[str, Any]:
    """Read a TOML file, in UTF-8 with or without a byte order mark.

    Args:
        path: the file.
        kind: what it holds, for people, such as "bench".
        next_step: what to do where it cannot be read.

    Raises:
        ConfigError: it cannot be read, or is not TOML.
    """
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_TOML + 1)
        if len(content) > LARGEST_TOML:
            raise ConfigError(
                f"{kind} {path} is longer than {LARGEST_TOML // 1000} kB", "give another file"
            )
        values = tomllib.loads(content.decode("utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ConfigError(f"cannot read {kind} {path}: {reason}", next_step) from None
    except (ValueError, RecursionError) as error:  # thousands of digits, or of brackets, too
        raise ConfigError(f"{kind} {path} is not TOML: {error}", "correct the file") from None
    if _depth(values) > DEEPEST_TOML:
        raise ConfigError(
            f"{kind} {path} has values within values, more than {DEEPEST_TOML} deep",
            "correct the file",
        )
    return values


def _depth(values: Any) -> int:
    """Return how many tables and arrays contain each other, without recursion."""
    level, depth = [values], 0
    while level and depth <= DEEPEST_TOML:
        depth += 1
        inner = [part.values() if isinstance(part, dict) else part for part in level]
        level = [v for part in inner for v in part if isinstance(v, dict | list)]
    return depth


def write_whole(path: Path, data: str | bytes, next_step: str) -> None:
    """Write a file whole or not at all; an older one stays until the new one is complete.

    A device, a pipe or a link, such as /dev/stdout, stays what it is.

    Args:
        path: the file.
        data: its content; text is written in UTF-8.
        next_step: what to do where it cannot be written.

    Raises:
        ConfigError: it cannot be written.
    """
    content = data.encode() if isinstance(data, str) else data
    if path.exists() and not (path.is_file() or path.is_dir()):
        with _refusals(path, next_step):
            path.write_bytes(content)
        return
    target = path.resolve() if path.is_symlink() else path  # a link stays a link
    with replacing(target, next_step) as part:
        part.write_bytes(content)


@contextmanager
def replacing(path: Path, next_step: str) -> Iterator[Path]:
    """Give a path beside `path` to write to, which replaces `path` at the end of the block.

    Where the block fails, what it has written is removed and `path` stays as it was.

    Args:
        path: the file, or the link.
        next_step: what to do where it cannot be written.

    Raises:
        ConfigError: it cannot be written.
    """
    part = path.with_name(f"{path.name}.part")
    try:
        with _refusals(path, next_step):
            yield part
            part.replace(path)
    finally:
        with suppress(OSError):
            part.unlink()


@contextmanager
def _refusals(path: Path, next_step: str) -> Iterator[None]:
    """Raise a ConfigError where the system refuses to write a file."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        raise ConfigError(f"cannot write {path}: {reason}", next_step) from None


def first_problem(
    error: ValidationError,
    keys: Callable[[tuple[str, ...]], list[str]],
    elsewhere: Mapping[str, str] | None = None,
) -> tuple[str, str]:
    """Return the first thing wrong with the values of a file, and what to do; unknown keys first.

    Args:
        error: what pydantic found.
        keys: lists the keys that are allowed in a section, such as () or ("camera",).
        elsewhere: keys of other sections, with their full names there; one of these is proposed
            for an unknown key that resembles no key of its own section, or that is at the top
            level and has exactly that name.
    """
    problem = min(error.errors(), key=lambda found: found["type"] not in _UNKNOWN)
    path = tuple(shortened(str(part), 60) for part in problem["loc"])
    where = ".".join(path)
    if problem["type"] in _UNKNOWN:
        *section, name = path
        known, others = keys(path[:-1]), elsewhere or {}
        exact = [others[name]] if name in others and not section else []
        near = [".".join((*section, key)) for key in get_close_matches(name, known, 1)]
        far = [others[key] for key in get_close_matches(name, others, 1)]
        if meant := exact + near + far:
            return f"unknown key {where}", f"did you mean {meant[0]}?"
        return f"unknown key {where}", f"known are {', '.join(known)}"
    what, next_step = _explained(problem, where)
    return f"{where}: {what}" if where else what, next_step


def _explained(problem: Any, where: str) -> tuple[str, str]:
    """Return what is wrong with one value, and what to do."""
    kind, value = problem["type"], problem["input"]
    if kind == "value_error":  # raised by a check of ours
        error = problem["ctx"]["error"]
        known = isinstance(error, EndolockError)
        return (error.what, error.next_step) if known else (str(error), "")
    if kind == "missing":
        return "missing", "give it"
    if kind == "union_tag_invalid":
        given, key, known = (problem["ctx"][k] for k in ("tag", "discriminator", "expected_tags"))
        key = str(key).strip("'")
        return f"got {key} {shown(str(given))}, wanted {known}", "use one of these"
    if kind == "union_tag_not_found":
        return f"{problem['ctx']['discriminator']} is missing", "give it"
    if kind == "tuple_type" and isinstance(value, dict):
        return "there may be several", f"write [[{where}]]"
    if kind == "model_type" and isinstance(value, list | tuple):
        return "there is only one", f"write [{where}]"
    what = f"{problem['msg'].replace('Input should be', 'should be')}, got {shown(value)}"
    return what, _TYPES.get(kind, "correct it")


def _models(folder: str) -> Any:
    return resources.files("endolock") / "models" / folder
