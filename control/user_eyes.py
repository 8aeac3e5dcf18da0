"""Eyes of the user's own, checked: their errors become one line, their observations are copied."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import isfinite
from operator import index
from typing import Any

from endolock.control.user_controller import caller_of, floats
from endolock.hw.api import ConfigError, Frame
from endolock.vision.observation import Observation, Status, Turn


def _floats(values: Any, count: int) -> tuple[float, ...]:
    copy = floats(values)
    if len(copy) != count:
        raise ValueError
    return copy


def _corners(values: Any) -> tuple[tuple[float, ...], ...]:
    return tuple(_floats(corner, 2) for corner in values)


def _turn(value: Any) -> Turn | None:
    if value is None:
        return None
    if not isinstance(value, Turn):
        raise TypeError
    first, second, third = (_finite(row) for row in value.covariance)
    since_s = float(value.since_s)
    return Turn(since_s=since_s, vector=_finite(value.vector), covariance=(first, second, third))


def _finite(values: Any) -> tuple[float, float, float]:
    x, y, z = _floats(values, 3)
    if not all(map(isfinite, (x, y, z))):
        raise ValueError
    return x, y, z


FIELDS: dict[str, Callable[[Any], Any]] = {
    "t_capture": float,
    "seq": index,
    "status": Status,
    "why": str,
    "target_px": partial(_floats, count=2),
    "covariance": partial(_floats, count=3),
    "distance_m": float,
    "reference_px": partial(_floats, count=2),
    "corners_px": _corners,
    "turn": _turn,
}
"""Makes a plain value of each field of an observation, which cannot change afterwards."""


class UserEyes:
    """Checks and copies what eyes return, and turns their errors into `ConfigError`.

    Args:
        eyes: turns a frame into an observation.

    Raises:
        ConfigError: they cannot be called.
    """

    def __init__(self, eyes: Any) -> None:
        self._eyes, self._caller = eyes, caller_of(eyes)
        if isinstance(eyes, type) or not callable(eyes):
            raise ConfigError(
                f"{self._caller.name} cannot be called with a frame",
                "give eyes: an object that turns a frame into an observation",
            )

    def __call__(self, frame: Frame) -> Observation:
        """Look at one frame.

        Raises:
            ConfigError: the eyes failed, or returned no usable observation.
        """
        seen = self._caller.call("looking at a frame", partial(self._eyes, frame))
        if not isinstance(seen, Observation):
            raise ConfigError(
                f"{self._caller.name}: returned {type(seen).__name__} for frame {frame.seq}",
                "return an endolock.Observation every time",
            )
        copy = self._caller.call("looking at a frame", partial(_copy, seen))
        if isinstance(copy, str):
            raise ConfigError(
                f"{self._caller.name}: {copy} in the observation of frame {frame.seq}",
                "see endolock.Observation",
            )
        return copy  # type: ignore[no-any-return]


def _copy(seen: Observation) -> Observation | str:
    """Return a copy made of plain values; or say which field has none."""
    values: dict[str, Any] = {}
    try:
        for name, convert in FIELDS.items():
            values[name] = convert(getattr(seen, name))
        tracking = values["status"] is Status.TRACKING
        if tracking and not all(map(isfinite, values[(name := "target_px")])):
            raise ValueError
    except (TypeError, ValueError):
        return f"{name} {getattr(seen, name)!r}"
    return Observation(**values)
