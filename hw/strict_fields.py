"""Fields of frozen dataclasses, believed only as far as values of files are; see `hw/strict.py`.

@dataclass(frozen=True, kw_only=True)
class Gains:
    kp: Annotated[float, bounded(0, 10, "rad/rad")] = 0.1

    def __post_init__(self) -> None:
        settle(self, "gains")
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from pydantic import ConfigDict, ValidationError

from endolock.hw.errors import ConfigError
from endolock.hw.files import first_problem
from endolock.hw.strict import Strict, model_of


def settle(made: Any, what: str) -> None:
    """Check the fields of a frozen dataclass: right types, finite, within the ranges they state.

    An integer becomes the real number that it stands for, an array a tuple.

    Args:
        made: a new object; called from `__post_init__`.
        what: what it is, for people.

    Raises:
        ConfigError: a value is not as its field states.
    """
    values = {field.name: _plain(getattr(made, field.name)) for field in fields(made)}
    kind: Any = type(made)
    try:
        settled = model_of(kind, _Parts).model_validate(values)
    except ValidationError as error:
        said, next_step = first_problem(error, lambda _section: [])
        raise ConfigError(f"{what}: {said}", next_step) from None
    for name in values:
        object.__setattr__(made, name, getattr(settled, name))


class _Parts(Strict):
    """Values that may be dataclasses, which are checked where they are made."""

    model_config = ConfigDict(arbitrary_types_allowed=True, protected_namespaces=())


def _plain(value: Any) -> Any:
    """Return a number of NumPy as one of Python, in a sequence too; others as they are."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Sequence) and not isinstance(value, str):
        return tuple(_plain(part) for part in value)
    return value
