"""Stands for the camera of a bench that has none, or whose camera gives no picture."""

from __future__ import annotations

from endolock.hw.api import Calibration, ConfigError, Frame


class AbsentCamera:
    """A camera that says why there is none as soon as somebody needs it.

    Handles can then be driven without it; whatever looks at pictures fails before they move.

    Args:
        why: why there are no pictures.
    """

    def __init__(self, why: ConfigError) -> None:
        self._why = why.what, why.next_step

    @property
    def calibration(self) -> Calibration:
        """Its geometry: eyes and controllers ask for it first.

        Raises:
            ConfigError: always.
        """
        raise ConfigError(*self._why)

    def latest(self) -> Frame | None:
        """Return the newest frame.

        Raises:
            ConfigError: always.
        """
        raise ConfigError(*self._why)

    def close(self) -> None:
        """Nothing to do."""
