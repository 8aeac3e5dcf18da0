"""Fields of an experiment: converted from what users pass, and written as plain values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from operator import index
from pathlib import Path
from typing import Any

from endolock.hw.api import ConfigError
from endolock.hw.strict import shown
from endolock.twin.world.scenario import Scenario


def _pixels(values: Any) -> tuple[int, ...]:
    if any(isinstance(value, bool) for value in values):
        raise TypeError
    left, top, width, height = (index(value) for value in values)
    return left, top, width, height


CONVERSIONS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "bench": ("a path", Path),
    "select": ("left, top, width and height in whole pixels", _pixels),
    "latency_s": ("a number of seconds", float),
    "duration_s": ("a number of seconds", float),
    "scored_from_s": ("a number of seconds", float),
    "vary": ("a tuple of texts such as ('law.ki=1',)", tuple),
    "seed": ("a whole number, 0 or more", index),
    "out": ("a path", Path),
}
"""What a field must be, and what converts to it."""
ALWAYS = ("vary", "seed")
"""Fields that are never None."""


def converted(name: str, value: Any) -> Any:
    """Convert the value of one of `CONVERSIONS`, such as a text to a path or a NumPy integer.

    Raises:
        ConfigError: it cannot be converted.
    """
    kind, convert = CONVERSIONS[name]
    if value is None and name not in ALWAYS:
        return None
    try:
        if isinstance(value, str | bool) and convert is not Path:
            raise TypeError
        result = convert(value)
        if name == "seed" and not 0 <= result < 2**63:  # as files and tables hold it
            raise ValueError
        return result
    except (TypeError, ValueError, OverflowError):
        raise ConfigError(f"{name} {shown(value)}", f"use {kind}") from None


def described(values: Mapping[str, Any], controller: str) -> dict[str, Any]:
    """Return the fields as plain values for run.toml; objects by the name of their class.

    Args:
        values: all fields by name.
        controller: name of the controller.
    """
    plain = dict(values)
    for name, value in values.items():
        if name == "scenario" and isinstance(value, Scenario):
            plain[name] = value.name
        elif name == "controller" and not isinstance(value, str):
            plain[name] = controller
        elif name == "select" and value:
            plain[name] = ",".join(map(str, value))
        elif isinstance(value, Path):
            plain[name] = str(value)
        elif name in ("rig", "vision", "instrument") and not isinstance(value, str):
            plain[name] = type(value).__name__
    return plain
