"""What can go wrong, as one line for a person: what was wanted, what came, what to do next."""

from __future__ import annotations

from typing import Any, Literal


class EndolockError(Exception):
    """Root of all errors that a user can meet, as data; `str(error)` is the sentence for a person.

    Args:
        what: what was asked for and what was found instead.
        next_step: what to do about it; empty where there is nothing to do.
    """

    def __init__(self, what: str, next_step: str = "") -> None:
        super().__init__(what, next_step)
        self.what = what
        self.next_step = next_step

    def __str__(self) -> str:
        return "; ".join(part for part in (self.what, self.next_step) if part)

    def __reduce__(self) -> tuple[Any, ...]:
        # Exception would call __init__ with `args` alone, and lose the keyword-only fields.
        return type(self).__new__, (type(self), *self.args), self.__dict__


class ConfigError(EndolockError, ValueError):
    """A scenario, option, parameter or file is not usable (exit code 2)."""


class HardwareError(EndolockError, RuntimeError):
    """Something between the command and the handle went wrong (exit code 3).

    Args:
        what: what was asked for and what was found instead.
        next_step: what to do about it.
        t: clock time of the event [s].
        axis: name of the axis concerned, where there is one.
    """

    def __init__(
        self, what: str, next_step: str = "", *, t: float, axis: str | None = None
    ) -> None:
        super().__init__(what, next_step)
        self.t = t
        self.axis = axis


class StateError(HardwareError):
    """The call does not fit the present mode, for example a command before `enable()`."""


class CommandError(HardwareError, ValueError):
    """A command has the wrong shape or is not finite; the previous goal stays."""


class LinkError(HardwareError, ConnectionError):
    """The line to the handles cannot be used."""


class PortBusy(LinkError):
    """Another program holds the port."""


class PortGone(LinkError):
    """The port is not there, or was unplugged; latched until `clear_fault()`."""


class LinkLost(LinkError):
    """No fresh state came within the allowed age; latched until `clear_fault()`."""


Fault = Literal[
    "watchdog", "overload", "overheat", "voltage", "encoder", "following", "estop", "reset"
]
"""What a device or its guard may stop for."""


class DeviceFault(HardwareError):
    """A device or its guard stopped the motion; latched until `clear_fault()`.

    Args:
        what: what was asked for and what was found instead.
        next_step: what to do about it.
        kind: what tripped: watchdog, overload, overheat, voltage, encoder, following, estop or
            reset.
        t: clock time of the event [s].
        axis: name of the axis concerned, where there is one.
    """

    def __init__(
        self, what: str, next_step: str = "", *, kind: Fault, t: float, axis: str | None = None
    ) -> None:
        super().__init__(what, next_step, t=t, axis=axis)
        self.kind = kind
