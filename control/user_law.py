"""Controllers of the user's own: from a file, `--controller my_law.py`, or objects in Python.

The file defines make(calibration), which returns the controller: anything with `reset` and `update`
as in `loop.Controller`. Other parameters of `make` can be set with `--vary law.NAME=VALUE`. The
file may import modules beside it. It is executed once in a process, so its globals live as long; a
run's state belongs in the controller. What it prints goes to standard error. An error in it ends
the run with one line that names the line in the file, and the handles hold.
"""

from __future__ import annotations

import contextlib
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache, partial
from math import isfinite
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from endolock.hw.api import AXES, Calibration, Command, ConfigError, State
from endolock.hw.errors import did_you_mean
from endolock.vision.observation import Observation

SUFFIX = ".py"


class UserController:
    """Checks the return values of a user controller, and turns its errors into `ConfigError`.

    Args:
        controller: has `reset(state)` and `update(t, state, observation)`.
        file: the file that made it; None for an object made in Python.

    Raises:
        ConfigError: it lacks a method.
    """

    def __init__(self, controller: Any, file: Path | None = None) -> None:
        self._controller, self._quiet = controller, file is not None
        self._name = file.name if file else type(controller).__name__
        self._source = file or _source_of(type(controller))
        for method in ("reset", "update"):
            if isinstance(controller, type) or not callable(getattr(controller, method, None)):
                made = "make returned " if file else ""
                kind = controller if isinstance(controller, type) else type(controller)
                what = f"the class {kind.__name__}" if kind is controller else kind.__name__
                raise ConfigError(
                    f"{self._name}: {made}{what}, which has no {method}()",
                    "return a controller with reset(state) and update(t, state, observation)",
                )

    @property
    def signals(self) -> Mapping[str, float]:
        """Internal values of the controller, by name; recorded with each tick.

        Raises:
            ConfigError: they are not a mapping of names to numbers.
        """
        if inspect.getattr_static(self._controller, "signals", None) is None:
            return {}
        values = self._call("signals", lambda: self._controller.signals)
        try:
            return {str(name): float(value) for name, value in dict(values or {}).items()}
        except (TypeError, ValueError):
            raise ConfigError(
                f"{self._name}: signals is {values!r}", "make it a mapping of names to numbers"
            ) from None

    def reset(self, state: State) -> None:
        """Restart from the current handle state."""
        self._call("reset", partial(self._controller.reset, state))

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Update the controller for one tick, and check the command that it returns.

        Raises:
            ConfigError: the controller failed, or returned no usable command.
        """
        call = partial(self._controller.update, t, state, observation)
        command = self._call("update", call)
        if not isinstance(command, Command):
            raise ConfigError(
                f"{self._name}: update returned {type(command).__name__} at {t:.2f} s",
                "return endolock.Command(position=(up_down, left_right)) every time",
            )
        position: list[float] = []
        if not isinstance(command.position, str | Mapping | set):
            with contextlib.suppress(TypeError, ValueError):
                position = [float(p) for p in command.position]
        if len(position) != len(AXES) or not all(isfinite(p) for p in position):
            raise ConfigError(
                f"{self._name}: update returned the position {command.position!r} at {t:.2f} s",
                "return two finite angles in rad, (up_down, left_right)",
            )
        return Command(position=tuple(position), valid_for=command.valid_for)

    def _call(self, what: str, call: Callable[[], Any]) -> Any:
        return call_user_code(call, self._name, what, self._source, quiet=self._quiet)


class UserLaw(NamedTuple):
    """A law file that has been executed."""

    file: Path
    """Where it is."""
    function: Callable[..., Any]
    """Its make(calibration, ...)."""

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
        call = partial(self.function, calibration, **settings)
        made = call_user_code(call, self.file.name, "make", self.file, quiet=True)
        return UserController(made, self.file)


def load(file: str) -> UserLaw:
    """Execute a file, once for each version of it on disk.

    Raises:
        ConfigError: it cannot be read or executed, or defines no `make`.
    """
    path = Path(file)
    if not path.is_file():
        raise ConfigError(f"controller {file}: there is no such file", "check the path")
    return _executed(path.resolve(), path.stat().st_mtime_ns)


@lru_cache(maxsize=16)
def _executed(path: Path, _changed_ns: int) -> UserLaw:
    name = f"endolock_user_law_{path.stem}_{abs(hash(path.parent)):x}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses and pickle look it up there
    with _imports_beside(path):
        execute = partial(spec.loader.exec_module, module)
        call_user_code(execute, path.name, "", path, quiet=True)
    return UserLaw(path, _make_of(module, path))


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


def call_user_code(
    call: Callable[[], Any], name: str, what: str, source: Path | None, *, quiet: bool = False
) -> Any:
    """Call user code, and turn any error of it into one line.

    Args:
        call: the code, with its arguments.
        name: file or class, for the message.
        what: what is called, for the message; empty while a file is executed.
        source: the file that defines it, if known.
        quiet: whether it prints to standard error and not to standard output.

    Raises:
        ConfigError: it failed, or left the program.
    """
    output = contextlib.redirect_stdout(sys.stderr) if quiet else contextlib.nullcontext()
    try:
        with output:
            return call()
    except (Exception, SystemExit) as error:  # user code may raise anything
        did = f"{what} failed" if what else "cannot be executed"
        raise ConfigError(f"{name}: {did}: {_description(error, source, call)}") from error


def _description(error: BaseException, source: Path | None, call: Any) -> str:
    """Describe an error by type and message, and by the last line of the file that led to it."""
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if source and Path(frame.filename) == source]
    text = " ".join(str(error).split()) or "no message"
    code = getattr(getattr(call, "func", None), "__code__", None)
    if isinstance(error, SyntaxError) and error.filename == str(source):
        lines, text = [error.lineno], error.msg
    elif not lines and code and Path(code.co_filename) == source:
        lines = [code.co_firstlineno]  # a call with arguments that it does not take
    return f"{type(error).__name__}: {text}" + (f" (line {lines[-1]})" if lines else "")


def _source_of(kind: type) -> Path | None:
    """Return the file that defines a class; None for one that was typed in."""
    try:
        return Path(inspect.getsourcefile(kind) or "")
    except (OSError, TypeError):
        return None
