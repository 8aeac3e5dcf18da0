"""User controllers: from a file, `--controller my_law.py`, or objects in Python.

The file defines make(calibration), which returns the controller: anything with `reset` and `update`
as in `loop.Controller`. Keyword parameters of `make` can be set with `--vary law.NAME=VALUE`. The
file may import modules beside it. It is executed once; what it prints goes to standard error. An
error in it ends the run with one line that names the line in the file, and the handles hold.
"""

from __future__ import annotations

import contextlib
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from functools import lru_cache
from math import isfinite
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from endolock.hw.api import AXES, Calibration, Command, ConfigError, State
from endolock.vision.observation import Observation

SUFFIX = ".py"


class UserController:
    """Checks the return values of a user controller, and turns its errors into `ConfigError`.

    Args:
        controller: has `reset(state)` and `update(t, state, observation)`.
        file: the file that defines it; None if unknown.

    Raises:
        ConfigError: it lacks a method.
    """

    def __init__(self, controller: Any, file: Path | None = None) -> None:
        self._controller, self._file = controller, file
        self._name = file.name if file else type(controller).__name__
        for method in ("reset", "update"):
            if not callable(getattr(controller, method, None)):
                made = "make returned " if file else ""
                raise ConfigError(
                    f"{self._name}: {made}{type(controller).__name__}, which has no {method}()",
                    "return a controller with reset(state) and update(t, state, observation)",
                )

    @property
    def signals(self) -> Mapping[str, float]:
        """Internal values of the controller, by name; recorded with each tick.

        Raises:
            ConfigError: a value is not a number.
        """
        values = _call(self._name, self._file, "signals", self._signals)
        try:
            return {str(name): float(value) for name, value in values.items()}
        except (TypeError, ValueError):
            raise ConfigError(
                f"{self._name}: signals is {values!r}", "make it a mapping of names to numbers"
            ) from None

    def _signals(self) -> dict[str, Any]:
        return dict(getattr(self._controller, "signals", None) or {})

    def reset(self, state: State) -> None:
        """Restart from the current handle state."""
        _call(self._name, self._file, "reset", self._controller.reset, state)

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Update the controller for one tick, and check the command that it returns.

        Raises:
            ConfigError: the controller failed, or returned no usable command.
        """
        update = self._controller.update
        command = _call(self._name, self._file, "update", update, t, state, observation)
        if not isinstance(command, Command):
            raise ConfigError(
                f"{self._name}: update returned {type(command).__name__} at {t:.2f} s",
                "return endolock.Command(position=(up_down, left_right)) at every tick",
            )
        try:
            position = [float(p) for p in command.position]
        except (TypeError, ValueError):
            position = []
        if len(position) != len(AXES) or not all(isfinite(p) for p in position):
            raise ConfigError(
                f"{self._name}: update returned the position {command.position!r} at {t:.2f} s",
                "return two finite angles in rad, (up_down, left_right)",
            )
        return command


class UserLaw(NamedTuple):
    """An executed file that makes a controller."""

    file: Path
    """Path of the file."""
    function: Callable[..., Any]
    """Its make(calibration, ...)."""

    @property
    def parameters(self) -> list[str]:
        """Names that `--vary law.NAME` can set: those of `make` after the calibration."""
        kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
        try:
            given = inspect.signature(self.function).parameters.values()
        except (TypeError, ValueError):  # a callable written in C
            return []
        return [p.name for p in given if p.kind in kinds][1:]

    def configure(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Check changed parameters, and return them.

        Raises:
            ConfigError: `make` has no such parameter.
        """
        known = self.parameters
        for name in changes:
            if name not in known:
                near = get_close_matches(name, known, 1)
                hint = f"; did you mean law.{near[0]}?" if near else ""
                choice = f"use {', '.join(known)}" if known else "its make has only calibration"
                raise ConfigError(f"{self.file.name}: make has no parameter {name}", choice + hint)
        return dict(changes)

    def make(self, calibration: Calibration, settings: Mapping[str, Any]) -> UserController:
        """Make the controller.

        Raises:
            ConfigError: `make` failed, or returned something else.
        """
        name = self.file.name
        made = _call(name, self.file, "make", self.function, calibration, **settings)
        return UserController(made, self.file)


def load(file: str) -> UserLaw:
    """Execute a file once, and again only after it has changed on disk.

    Raises:
        ConfigError: it cannot be read or executed, or defines no `make`.
    """
    path = Path(file)
    if not path.is_file():
        raise ConfigError(f"controller file {file} does not exist", "check the path")
    return _executed(path.resolve(), path.stat().st_mtime_ns)


@lru_cache(maxsize=16)
def _executed(path: Path, _changed_ns: int) -> UserLaw:
    name = f"endolock_user_law_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses and pickle look it up there
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))  # last, so that files beside it shadow no other module
    _call(path.name, path, "", spec.loader.exec_module, module)
    return UserLaw(path, _make_of(module, path))


def _make_of(module: ModuleType, path: Path) -> Callable[..., Any]:
    make = getattr(module, "make", None)
    if not callable(make):
        raise ConfigError(
            f"{path.name}: defines no make(calibration)", "make it return your controller"
        )
    function: Callable[..., Any] = make
    return function


def _call(
    name: str, file: Path | None, method: str, call: Callable[..., Any], *args: Any, **options: Any
) -> Any:
    """Call user code: errors become one line, and what a file prints goes to stderr."""
    output = contextlib.redirect_stdout(sys.stderr) if file else contextlib.nullcontext()
    try:
        with output:
            return call(*args, **options)
    except Exception as error:  # user code may raise anything
        problem = f"{method} failed" if method else "cannot be executed"
        raise ConfigError(f"{name}: {problem}: {_description(error, file)}") from error


def _description(error: Exception, file: Path | None) -> str:
    """Describe an error by its type, its message, and the last line of the file that led to it."""
    frames = traceback.extract_tb(error.__traceback__)
    in_file = [frame for frame in frames if file and Path(frame.filename) == file]
    line = (in_file or frames)[-1].lineno
    if isinstance(error, SyntaxError) and error.lineno and not in_file:
        line = error.lineno
    text = " ".join(str(error).split()) or "no message"
    return f"{type(error).__name__}: {text} (line {line})"
