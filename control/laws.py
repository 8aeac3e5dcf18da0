"""The control laws by name."""

from __future__ import annotations

from collections.abc import Callable
from difflib import get_close_matches

from endolock.control.inverse_kinematics import InverseKinematics
from endolock.control.loop import Controller
from endolock.control.pi import PI
from endolock.hw.api import Calibration, ConfigError

LAWS: dict[str, Callable[[Calibration], Controller]] = {"ik": InverseKinematics, "pi": PI}
"""Each law is made from the calibration of the tip camera; adding one here is all it takes."""


def check(name: str) -> None:
    """See that there is a law of that name.

    Raises:
        ConfigError: there is none.
    """
    if name not in LAWS:
        near = get_close_matches(name, LAWS, 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise ConfigError(f"controller '{name}' is unknown; use {', '.join(sorted(LAWS))}{hint}")


def make(name: str, calibration: Calibration) -> Controller:
    """Make a law with its default parameters.

    Raises:
        ConfigError: there is no law of that name.
    """
    check(name)
    return LAWS[name](calibration)
