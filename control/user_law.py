"""A law from a file of one's own: `--controller my_law.py`.

The file defines make(calibration), which returns the law: anything with `reset` and `update` as in
`loop.Controller`. What such a law does wrong ends the run with one line and the handles held.
"""

from __future__ import annotations

import runpy
import traceback
from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import Any

from endolock.hw.api import AXES, Calibration, Command, ConfigError, State
from endolock.vision.observation import Observation

SUFFIX = ".py"


class PlugIn:
    """Stands between the loop and a law that nobody here has seen.

    Args:
        file: where its `make` is defined.
        calibration: is handed to it.

    Raises:
        ConfigError: the file cannot be read or run, or makes no law.
    """

    def __init__(self, file: str, calibration: Calibration) -> None:
        self._file = Path(file).name
        make = load(file)
        self._law: Any = self._safely("make", make, calibration)
        for method in ("reset", "update"):
            if not callable(getattr(self._law, method, None)):
                raise ConfigError(
                    f"{self._file}: make returned {type(self._law).__name__}, which has no "
                    f"{method}()",
                    "return a law with reset(state) and update(t, state, observation)",
                )

    def reset(self, state: State) -> None:
        """Hand on."""
        self._safely("reset", self._law.reset, state)

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Hand on, and look at what comes back.

        Raises:
            ConfigError: the law failed, or its command is none.
        """
        command = self._safely("update", self._law.update, t, state, observation)
        if not isinstance(command, Command):
            raise ConfigError(
                f"{self._file}: update returned {type(command).__name__} at {t:.2f} s",
                "return endolock.hw.api.Command(position=(up_down, left_right)) every time",
            )
        try:
            position = [float(p) for p in command.position]
        except (TypeError, ValueError):
            position = []
        if len(position) != len(AXES) or not all(isfinite(p) for p in position):
            raise ConfigError(
                f"{self._file}: update returned the position {command.position!r} at {t:.2f} s",
                "return two finite angles in rad, (up_down, left_right)",
            )
        return command

    def _safely(self, what: str, call: Callable[..., Any], *args: Any) -> Any:
        try:
            return call(*args)
        except Exception as error:  # whatever somebody's law raises
            raise ConfigError(f"{self._file}: {what} failed: {_said(error)}") from error


def load(file: str) -> Callable[..., Any]:
    """Run a file and return its `make`.

    Raises:
        ConfigError: it cannot be read or run, or defines none.
    """
    if not Path(file).is_file():
        raise ConfigError(f"controller {file}: there is no such file", "check the path")
    try:
        names = runpy.run_path(file)
    except Exception as error:  # whatever stands in the file
        raise ConfigError(f"{Path(file).name}: cannot be run: {_said(error)}") from error
    if not callable(names.get("make")):
        raise ConfigError(
            f"{Path(file).name}: defines no make(calibration)", "let it return your law"
        )
    make: Callable[..., Any] = names["make"]
    return make


def _said(error: Exception) -> str:
    line = traceback.extract_tb(error.__traceback__)[-1].lineno
    text = " ".join(str(error).split()) or "no message"
    return f"{type(error).__name__}: {text} (line {line})"
