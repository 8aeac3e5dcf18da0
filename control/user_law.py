"""Controllers from a file of the user's own: `--controller my_law.py`.

The file defines make(calibration), which returns the controller: anything with `reset` and `update`
as in `loop.Controller`. Other parameters of `make` can be set with `--vary law.NAME=VALUE`. The
file may import modules beside it. It is executed anew for every run, so that no run depends on the
globals that another one left. What it prints goes to standard error. An error in it ends the run
with one line that names the line in the file, and the handles hold.
"""

from __future__ import annotations

import contextlib
import importlib.util
import inspect
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextvars import copy_context
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from endolock.control.user_code import Caller
from endolock.control.user_controller import UserController
from endolock.hw.api import Calibration, ConfigError
from endolock.hw.errors import did_you_mean

SUFFIX = ".py"


class UserLaw(NamedTuple):
    """A law file that has been executed."""

    file: Path
    """Where it is."""
    function: Callable[..., Any]
    """Its make(calibration, ...)."""
    caller: Caller
    """Calls its code."""

    def configure(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Check changed parameters of `make`, and return them.

        Raises:
            ConfigError: it has no such parameter, or needs one that is not given.
        """
        parameters = self._parameters()
        names = [p.name for p in parameters if p.kind is not inspect.Parameter.VAR_KEYWORD]
        for name in changes:
            if name not in names and len(names) == len(parameters):
                hint = did_you_mean(name, names, "law.")
                choice = f"use {', '.join(names)}" if names else "its make has only calibration"
                raise ConfigError(f"{self.file.name}: make has no parameter {name}", choice + hint)
        for p in parameters:
            if p.name in names and p.default is p.empty and p.name not in changes:
                raise ConfigError(
                    f"{self.file.name}: make needs law.{p.name}",
                    f"give it with --vary law.{p.name}=..., or give it a default",
                )
            if p.name in changes and not _fits(changes[p.name], kind := _kind(p)):
                raise ConfigError(
                    f"{self.file.name}: law.{p.name} is {changes[p.name]!r}",
                    f"give {KINDS[kind]}, as the annotation or the default in make says",
                )
        return dict(changes)

    def _parameters(self) -> list[inspect.Parameter]:
        """Return the parameters after the calibration that can be given by name."""
        try:
            parameters = list(inspect.signature(self.function).parameters.values())
        except (TypeError, ValueError):  # a callable written in C
            return []
        if parameters and parameters[0].kind is not inspect.Parameter.VAR_POSITIONAL:
            del parameters[0]
        other = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.VAR_POSITIONAL)
        return [p for p in parameters if p.kind not in other]

    def make(self, calibration: Calibration, settings: Mapping[str, Any]) -> UserController:
        """Make the controller.

        Raises:
            ConfigError: `make` failed, or returned something else.
        """
        _fresh.pop(self.file, None)  # the next run executes it again
        with contextlib.chdir(os.curdir):
            made = self.caller.call("make", partial(self.function, calibration, **settings))
        return UserController(made, self.caller)


KINDS = {bool: "true or false", int: "a whole number", float: "a number"}
"""Types that a parameter of `make` may ask for."""


def _kind(parameter: inspect.Parameter) -> type:
    """Return which of `KINDS` a parameter asks for; `object` for any other."""
    for kind in KINDS:
        if parameter.annotation in (kind, kind.__name__):
            return kind
    if parameter.annotation is not parameter.empty:
        return object
    kind = type(parameter.default)
    return {bool: bool, int: float, float: float}.get(kind, object)  # 1 may stand for 1.0


def _fits(value: Any, kind: type) -> bool:
    if kind is bool or isinstance(value, bool):
        return kind is object or (kind is bool and isinstance(value, bool))
    return kind is object or isinstance(value, (int, float) if kind is float else int)


_fresh: dict[Path, tuple[int, UserLaw]] = {}
"""Executed files from which no controller was made yet, with the time of their last change."""


def load(file: str) -> UserLaw:
    """Execute a file, unless it was executed before and is unused and unchanged since.

    Raises:
        ConfigError: it cannot be read or executed, or defines no `make`.
    """
    path = Path(file)
    if not path.is_file():
        raise ConfigError(f"controller {file}: there is no such file", "check the path")
    path, changed_ns = path.resolve(), path.stat().st_mtime_ns
    before = _fresh.get(path)
    if before is None or before[0] != changed_ns:
        before = _fresh[path] = changed_ns, _executed(path)
    return before[1]


def _executed(path: Path) -> UserLaw:
    name = f"endolock_user_law_{path.stem}_{abs(hash(path.parent)):x}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses and pickle look it up there
    caller = Caller(path.name, path, copy_context(), quiet=True)
    with _imports_beside(path), contextlib.chdir(os.curdir):  # whatever folder it changes to
        caller.call("", partial(spec.loader.exec_module, module))
    return UserLaw(path, _make_of(module, path), caller)


@contextlib.contextmanager
def _imports_beside(file: Path) -> Iterator[None]:
    """Let a file import modules beside it; files elsewhere may have modules of the same names.

    The folder comes last on the path, so that it shadows nothing.
    """
    before, folder = set(sys.modules), str(file.parent)
    sys.path.append(folder)
    try:
        yield
    finally:
        sys.path.remove(folder)
        for name in set(sys.modules) - before:
            source = getattr(sys.modules[name], "__file__", None)
            if source and Path(source).is_relative_to(file.parent):
                del sys.modules[name]


def _make_of(module: ModuleType, path: Path) -> Callable[..., Any]:
    make = getattr(module, "make", None)
    if not callable(make):
        raise ConfigError(
            f"{path.name}: defines no make(calibration)", "let it return your controller"
        )
    function: Callable[..., Any] = make
    return function
