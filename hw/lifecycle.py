"""How a rig with a line is entered and left: connected, and closed whatever happened."""

from __future__ import annotations

from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self

from endolock.hw.api import EndolockError
from endolock.hw.guard import Guard


class ClosingRig(ABC):
    """A context that connects the handles; leaving it closes the rig."""

    actuators: Guard

    @abstractmethod
    def close(self) -> None:
        """Switch the handles off and let go of everything; may be called twice."""

    def __enter__(self) -> Self:
        """Connect the handles; where that fails, let go of the rest."""
        try:
            self.actuators.connect()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close, without hiding an exception on its way out."""
        try:
            self.close()
        except EndolockError as second:
            if error is None:
                raise
            error.add_note(f"and the handles could not be closed: {second}")
