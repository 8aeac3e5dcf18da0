"""Checks of what simulated rigs are made from."""

from __future__ import annotations

from operator import index
from typing import Any, TypeVar

from endolock.hw.api import ConfigError
from endolock.twin.world.instrument import Instrument, Numerics

Kind = TypeVar("Kind", Instrument, Numerics)
CLOSED = ("this rig is closed", "make a new one")
"""What is wrong with a rig that is used after it was closed, and what to do."""


def seed_of(value: Any) -> int:
    """Return a seed.

    Raises:
        ConfigError: it is not a whole number, 0 or more.
    """
    try:
        if isinstance(value, bool) or index(value) < 0:
            raise ValueError
        return index(value)
    except (TypeError, ValueError):
        raise ConfigError(f"seed {value!r}", "use a whole number, 0 or more") from None


def parameters(kind: type[Kind], value: Any) -> Kind:
    """Return an object of a class of parameters; the defaults if None.

    Raises:
        ConfigError: it is something else, such as a name.
    """
    if value is None:
        return kind()
    if not isinstance(value, kind):
        first = "load one with endolock.load_instrument" if kind is Instrument else "make one"
        raise ConfigError(f"{value!r} is not of the class {kind.__name__}", f"{first} and give it")
    return value
