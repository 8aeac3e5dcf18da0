"""Errors as data: what happened, what to do next, and which calls resume.

The sentence is made at the edge: `str(error)` for programs, which can make the calls, and
`for_people(error)` for somebody who runs commands.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from functools import partial
from typing import Any, Literal

RESUME = ("clear_fault", "enable")
"""Calls that resume after a latched fault."""


class EndolockError(Exception):
    """Root of all errors that a user can meet.

    Args:
        what: what was expected and what was found instead; or an error of another process, which
            some libraries raise again in this way, such as Gymnasium's vector environments.
        next_step: what to do about it; empty where there is nothing to do.
    """

    def __init__(self, what: str | Exception, next_step: str = "") -> None:
        what, next_step = one_line(str(what)), one_line(next_step)
        super().__init__(what, next_step)
        self.what = what
        self.next_step = next_step

    def __str__(self) -> str:
        return "; ".join(part for part in (self.what, self.next_step) if part)

    def __reduce__(self) -> tuple[Any, ...]:
        # Exception would call the class with `args` alone, without the keyword-only fields.
        fields = {
            k: v for k, v in vars(self).items() if k not in ("what", "next_step", "__notes__")
        }
        return partial(type(self), **fields), self.args, vars(self)


class ConfigError(EndolockError, ValueError):
    """A scenario, option, parameter or file is not usable (exit code 2)."""


class WiringError(ConfigError):
    """A handle turns the tip the wrong way, or about the other axis (exit code 2).

    Args:
        what: what was expected and what was found instead.
        next_step: what to do about it.
        axis: name of the handle.
    """

    def __init__(self, what: str, next_step: str = "", *, axis: str) -> None:
        super().__init__(what, next_step)
        self.axis = axis


class DamageWarning(UserWarning):
    """Part of a run folder is missing or damaged; what is whole was read."""


class HardwareError(EndolockError, RuntimeError):
    """Something between the command and the handle went wrong (exit code 3).

    Args:
        what: what was expected and what was found instead.
        next_step: what to do about it.
        recovery: calls on the actuators to make after that, in order, such as `RESUME`.
        t: clock time of the event [s].
        axis: name of the axis concerned, if it concerns one.
    """

    def __init__(
        self,
        what: str,
        next_step: str = "",
        *,
        recovery: tuple[str, ...] = (),
        t: float,
        axis: str | None = None,
    ) -> None:
        super().__init__(what, next_step)
        self.recovery = recovery
        self.t = t
        self.axis = axis

    def __str__(self) -> str:
        calls = " and ".join(f"{name}()" for name in self.recovery)
        if not calls:
            return super().__str__()
        step = f"{self.next_step}, then {calls}" if self.next_step else f"call {calls} first"
        return f"{self.what}; {step}"


class StateError(HardwareError):
    """The call does not fit the present mode, for example a command before `enable()`."""


class CommandError(HardwareError, ValueError):
    """A command has the wrong shape or is not finite; the previous goal stays."""


class LinkError(HardwareError, ConnectionError):
    """The line to the handles cannot be used."""


class PortBusy(LinkError):
    """Another program holds the port."""


class PortGone(LinkError):
    """The port does not exist, or was unplugged; latched until `clear_fault()`."""


class LinkLost(LinkError):
    """No fresh state came within the allowed age; latched until `clear_fault()`."""


Fault = Literal[
    "watchdog", "overload", "overheat", "voltage", "encoder", "following", "estop", "reset"
]
"""Why a device or its guard may stop."""


class DeviceFault(HardwareError):
    """A device or its guard stopped the motion; latched until `clear_fault()`.

    Args:
        what: what was expected and what was found instead.
        next_step: what to do about it.
        kind: what tripped, one of `Fault`.
        recovery: calls on the actuators that resume.
        t: clock time of the event [s].
        axis: name of the axis concerned, if it concerns one.
    """

    def __init__(
        self,
        what: str,
        next_step: str = "",
        *,
        kind: Fault,
        recovery: tuple[str, ...] = (),
        t: float,
        axis: str | None = None,
    ) -> None:
        super().__init__(what, next_step, recovery=recovery, t=t, axis=axis)
        self.kind = kind


def for_people(error: EndolockError) -> str:
    """Return all that an error says to somebody who runs commands: no calls, its notes included.

    A command starts afresh with torque off, so it resumes by running it again; only a fault that a
    motor had before it started needs the motors' supply switched off and on.
    """
    step = error.next_step
    if isinstance(error, HardwareError) and error.recovery:
        again = "run again"
        if isinstance(error, StateError) and "clear_fault" in error.recovery:
            again = "switch the motors' supply off and on, and run again"
        step = f"{step}, then {again}" if step else again
    notes = getattr(error, "__notes__", ())
    return "; ".join(part for part in (error.what, step, *notes) if part)


def one_line(text: str) -> str:
    """Return a text with what a terminal would obey, such as a new line, written as Python does."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def did_you_mean(name: str, known: Iterable[str], prefix: str = "") -> str:
    """Return "; did you mean NAME?" for the known name nearest to one; empty where none is near.

    Args:
        name: as it was given.
        known: names that exist.
        prefix: stands before names for the reader, such as "law.".
    """
    near = get_close_matches(name, list(known), 1)
    return f"; did you mean {prefix}{near[0]}?" if near else ""


def add_second(first: BaseException, what: str, second: BaseException) -> None:
    """Add an error met while handling another one to that one, as a note.

    Args:
        first: the error on its way out; it stays the one that is raised.
        what: what the second one kept from being done.
        second: the error met meanwhile.
    """
    reason = second.what if isinstance(second, EndolockError) else str(second)
    first.add_note(f"{what}: {reason or type(second).__name__}")
