"""What can go wrong, as one line for a person: what was wanted, what came, what to do next."""

from __future__ import annotations

from typing import Literal


class EndolockError(Exception):
    """Root of all errors a user can meet; the text says what was wanted, what came, what to do."""


class ConfigError(EndolockError, ValueError):
    """A scenario, option, parameter or file is not usable (exit code 2)."""


class HardwareError(EndolockError, RuntimeError):
    """Something between the command and the handle went wrong (exit code 3).

    Args:
        message: what happened and what to do next.
        t: clock time of the event [s].
        axis: name of the axis concerned, where there is one.
    """

    def __init__(self, message: str, *, t: float, axis: str | None = None) -> None:
        super().__init__(message)
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
        message: what happened and what to do next.
        kind: what tripped: watchdog, overload, overheat, voltage, encoder, following, estop or
            reset.
        t: clock time of the event [s].
        axis: name of the axis concerned, where there is one.
    """

    def __init__(self, message: str, *, kind: Fault, t: float, axis: str | None = None) -> None:
        super().__init__(message, t=t, axis=axis)
        self.kind = kind
