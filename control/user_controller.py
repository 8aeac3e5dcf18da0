"""Controllers of the user's own, checked: what they are, what they return, and their errors."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from contextlib import suppress
from contextvars import copy_context
from functools import partial
from math import inf, isfinite
from pathlib import Path
from typing import Any

from endolock.control.user_code import Caller
from endolock.hw.api import AXES, Command, ConfigError, State
from endolock.hw.strict import shown
from endolock.vision.observation import Observation


class UserController:
    """Checks and copies what a controller returns, and turns its errors into `ConfigError`.

    A command is copied when it is returned: the controller may keep it and change it afterwards.

    Args:
        controller: has `reset(state)` and `update(t, state, observation)`.
        caller: calls the code of the file that made it; None for an object made in Python.

    Raises:
        ConfigError: it lacks a method.
    """

    def __init__(self, controller: Any, caller: Caller | None = None) -> None:
        self._controller = controller
        self._caller = caller or caller_of(controller)
        for method in ("reset", "update"):
            if isinstance(controller, type) or not callable(getattr(controller, method, None)):
                made = "make returned " if caller else ""
                kind = controller if isinstance(controller, type) else type(controller)
                what = f"the class {kind.__name__}" if kind is controller else kind.__name__
                raise ConfigError(
                    f"{self._caller.name}: {made}{what}, which has no {method}()",
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
        values = self._caller.call("signals", self._numbers)
        if isinstance(values, str):
            raise ConfigError(
                f"{self._caller.name}: signals is {values}", "make it a mapping of names to numbers"
            )
        return values  # type: ignore[no-any-return]

    def reset(self, state: State) -> None:
        """Restart from the current handle state."""
        self._caller.call("reset", partial(self._controller.reset, state))

    def resume(self, state: State) -> None:
        """Continue after a time without frames; a controller without `resume` restarts."""
        resume = getattr(self._controller, "resume", None)
        if callable(resume):
            self._caller.call("resume", partial(resume, state))
        else:
            self.reset(state)

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Update the controller for one tick, and check the command that it returns.

        Raises:
            ConfigError: the controller failed, or returned no usable command.
        """
        call = partial(self._controller.update, t, state, observation)
        command = self._caller.call("update", call)
        name = self._caller.name
        if not isinstance(command, Command):
            raise ConfigError(
                f"{name}: update returned {type(command).__name__} at {t:.2f} s",
                "return endolock.Command(position=(up_down, left_right)) every time",
            )
        position = command.position
        if type(position) is not tuple or {*map(type, position)} != {float}:
            position = self._caller.call("update", partial(_floats, position))
        if len(position) != len(AXES) or not all(map(isfinite, position)):
            raise ConfigError(
                f"{name}: update returned the position {shown(command.position)} at {t:.2f} s",
                "return two finite angles in rad, (up_down, left_right)",
            )
        valid_for = (command.valid_for,)
        if type(command.valid_for) is not float:
            valid_for = self._caller.call("update", partial(_floats, valid_for))
        if not valid_for or not 0 < valid_for[0] < inf:
            given = shown(command.valid_for)
            raise ConfigError(
                f"{name}: update returned a command valid for {given} s at {t:.2f} s",
                "use more than 0, or leave valid_for out",
            )
        return Command(position=position, valid_for=valid_for[0])

    def _numbers(self) -> dict[str, float] | str:
        """Return a copy of the signals, or how they look where they are none."""
        values = self._controller.signals
        try:
            return {str(name): float(value) for name, value in dict(values or {}).items()}
        except (TypeError, ValueError):
            return repr(values)


def floats(values: Any) -> tuple[float, ...]:
    """Return a copy as plain numbers.

    Raises:
        TypeError, ValueError, OverflowError: it is no sequence of numbers.
    """
    if isinstance(values, str | bytes | Mapping | set):
        raise TypeError
    return tuple(float(value) for value in values)


def _floats(values: Any) -> tuple[float, ...]:
    """Return a copy as plain numbers; empty where it is no sequence of numbers."""
    with suppress(TypeError, ValueError, OverflowError):
        return floats(values)
    return ()


def caller_of(user_object: Any) -> Caller:
    """Return what calls the code of an object made in Python, which may print where it likes."""
    named = isinstance(user_object, type) or inspect.isroutine(user_object)
    code = user_object if named else type(user_object)
    return Caller(code.__name__, source_of(code), copy_context())


def source_of(code: Callable[..., Any]) -> Path | None:
    """Return the file that defines a class or a function; None for one that was typed in."""
    try:
        return Path(inspect.getsourcefile(code) or "")
    except (OSError, TypeError):
        return None
