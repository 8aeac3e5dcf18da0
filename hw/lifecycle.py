"""Opening and closing: rigs, handles and studios are contexts that are closed whatever happened.

An error while closing never hides the one before it; it is added to that one as a note.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from types import TracebackType
from typing import Self

from endolock.hw.api import Actuators
from endolock.hw.errors import add_second

UNCLOSED = "closing also failed"
"""How the note of an error begins that was met while closing."""


class Closing(ABC):
    """A context that is closed on exit."""

    @abstractmethod
    def close(self) -> None:
        """Release everything; may be called twice."""

    def __enter__(self) -> Self:
        """Nothing to do: already open."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close, without hiding an exception on its way out."""
        if error is None:
            self.close()
        else:
            close_after(error, self.close)


class Connecting(Closing):
    """A context that connects on entry; closed on exit, and where connecting fails."""

    @abstractmethod
    def connect(self) -> None:
        """Connect; without effect where it is connected already."""

    def __enter__(self) -> Self:
        """Connect; where that fails, release the rest."""
        try:
            self.connect()
        except BaseException as error:
            close_after(error, self.close)
            raise
        return self


class ClosingRig(Connecting):
    """A rig as a context."""

    actuators: Actuators

    def connect(self) -> None:
        """Connect the handles."""
        self.actuators.connect()


def close_after(error: BaseException, close: Callable[[], object]) -> None:
    """Close something because of an error; a second error becomes a note of the first."""
    try:
        close()
    except Exception as second:  # whatever a device does when it is closed badly
        add_second(error, UNCLOSED, second)


def close_all(*closes: Callable[[], object]) -> None:
    """Make all these calls, whatever each raises.

    Raises:
        BaseException: the first error, or the first interruption such as Ctrl-C; the others become
            notes of it.
    """
    errors: list[BaseException] = []
    for close in closes:
        try:
            close()
        except BaseException as error:
            errors.append(error)
    if not errors:
        return
    raised = next((stop for stop in errors if not isinstance(stop, Exception)), errors[0])
    for other in errors:
        if other is not raised:
            add_second(raised, UNCLOSED, other)
    raise raised
