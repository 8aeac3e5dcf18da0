"""Instruments as TOML files: those of the package, and files of your own.

A file gives the values that differ from the defaults of `Instrument`, in SI units under the same
names.
"""

from __future__ import annotations

import ast
import inspect
from dataclasses import asdict, fields
from pathlib import Path
from textwrap import wrap

from endolock.hw import files
from endolock.hw.api import ConfigError
from endolock.hw.errors import did_you_mean
from endolock.twin.world.instrument import Instrument

FOLDER = "instruments"


def names() -> list[str]:
    """List the instruments of the package."""
    return files.names(FOLDER)


def load(source: str | Path | Instrument) -> Instrument:
    """Read an instrument.

    Args:
        source: name of an instrument of the package, path of a TOML file, or an
            instrument, which is returned.

    Raises:
        ConfigError: there is no such instrument, the file is not TOML, a key is unknown, or a value
            is out of range.
    """
    if isinstance(source, Instrument):
        return source
    values, name = files.read("instrument", FOLDER, str(source))
    known = [field.name for field in fields(Instrument)]
    for key in values:
        if key not in known:
            hint = did_you_mean(key, known).removeprefix("; ")
            raise ConfigError(
                f"instrument {name}: unknown key {key}", hint or f"known are {', '.join(known)}"
            )
    try:
        return Instrument(**values)
    except ConfigError as error:
        raise ConfigError(f"{error.what}, in {source}", error.next_step) from None


def dump(instrument: Instrument, header: str) -> str:
    """Write an instrument as TOML: every value with its meaning, unit and source.

    Args:
        instrument: the parameters to write.
        header: the comment at the top, without comment marks.
    """
    lines = [f"# {line}".rstrip() for line in header.splitlines()]
    meaning_of = meanings()
    for name, value in asdict(instrument).items():
        lines += ["", *wrap(meaning_of[name], 98, initial_indent="# ", subsequent_indent="# ")]
        lines.append(f"{name} = {float(value)!r}")
    return "\n".join(lines) + "\n"


def meanings() -> dict[str, str]:
    """Return meaning, unit, range and source of every parameter of `Instrument`."""
    (body,) = ast.parse(inspect.getsource(Instrument)).body
    assert isinstance(body, ast.ClassDef)
    found: dict[str, str] = {}
    for field, text in zip(body.body, body.body[1:], strict=False):
        if (
            isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
        ):
            found[field.target.id] = inspect.cleandoc(str(text.value.value)).replace("\n", " ")
    return found
