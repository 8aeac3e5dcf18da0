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

UNCLOSED = "and not everything could be closed"
"""How the note of an error begins that was met while closing."""


class Closing(ABC):
    """A context that is closed on exit."""

    @abstractmethod
    def close(self) -> None:
        """Let go of everything; may be called twice."""

    def __enter__(self) -> Self:
        """Nothing to do: it is open since it was made."""
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
        """Connect; where that fails, let go of the rest."""
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
        BaseException: the first error; those after it become notes of it.
    """
    first: BaseException | None = None
    for close in closes:
        try:
            close()
        except BaseException as error:
            if first is None:
                first = error
            else:
                add_second(first, UNCLOSED, error)
    if first is not None:
        raise first
