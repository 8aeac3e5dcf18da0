"""Values that cannot change after they were handed out, so that no reader can affect another."""

from __future__ import annotations

from types import MappingProxyType, NoneType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Value = TypeVar("Value")
_PLAIN = frozenset((bool, float, int, str, NoneType))


class Frozen:
    """Base of records whose fields are frozen when they are made.

    Lists and arrays of one dimension become tuples, mappings read-only copies, and arrays of more
    dimensions copies that cannot be written; pictures become read-only without a copy, which would
    take time.
    """

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if type(value) not in _PLAIN and (frozen := freeze(value)) is not value:
                object.__setattr__(self, name, frozen)

    def __getstate__(self) -> dict[str, Any]:
        proxies = {k: dict(v) for k, v in vars(self).items() if isinstance(v, MappingProxyType)}
        return {**vars(self), **proxies}

    def __setstate__(self, values: dict[str, Any]) -> None:
        for value in values.values():  # arrays that come from another process are writeable
            read_only(value)
        vars(self).update(values)
        self.__post_init__()


def freeze(value: Any) -> Any:
    """Return a value that cannot be changed: itself, where that is so already, or a copy."""
    kind = type(value)
    if kind is tuple:
        if all(type(part) in _PLAIN for part in value):
            return value
        return tuple(map(freeze, value))
    if kind is list:
        return tuple(map(freeze, value))
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        if value.ndim < 2:
            return freeze(value.tolist())
        return _picture(value) if value.dtype == np.uint8 else fixed(value)
    if isinstance(value, dict):
        return MappingProxyType({key: freeze(part) for key, part in value.items()})
    return value


def read_only(array: Value) -> Value:
    """Make an array read-only, with those that it is a view of; return it, or anything else."""
    part: Any = array
    while isinstance(part, np.ndarray):
        part.flags.writeable = False
        part = part.base
    return array


def fixed(values: ArrayLike) -> NDArray[np.float64]:
    """Copy numbers into an array that cannot be made writeable again."""
    array = np.asarray(values, np.float64)
    if isinstance(_root(array), bytes):
        return array
    return np.frombuffer(array.tobytes()).reshape(array.shape)


def _picture(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    if not image.flags.writeable:
        return image
    view = image.view()  # the owner, such as the buffer of a camera, stays writeable
    view.flags.writeable = False
    return view


def _root(array: Any) -> Any:
    while isinstance(array, np.ndarray):
        array = array.base
    return array
