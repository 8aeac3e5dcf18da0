"""Values for the fields of a pydantic model or a dataclass: right, at a border, or wrong.

    made = Generated(np.random.default_rng(3), wrong=0.05).document(Scenario)

Most numbers are near the default, so that a document may be right as a whole; some are anywhere in
their range, at its ends or just beyond; with the probability `wrong`, a value is of another type or
in another unit.
"""

from __future__ import annotations

import dataclasses
import types
from functools import cache
from math import exp, inf, log, nan
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import BaseModel

from endolock.hw.strict import Bounded

WRONG: tuple[Any, ...] = (
    *(
        True,
        False,
        "",
        "640",
        "0.1",
        "a\nb",
        "\x1b[2J",
        None,
        nan,
        inf,
        -inf,
        [],
        [1],
        {},
        {"a": 1},
    ),
    *(10**400, -(10**400), 1e308, -1e308, 1e-308, 0, -1, 3, 1.5, [[[[0]]]], "x" * 5000),
)
"""Values of other types, and numbers that hardly any field may have."""
UNITS = (1e-6, 1e-3, 1e-2, 57.29578, 100.0, 1e3, 1e6, -1.0)
"""What a number is off by in another unit, or with another sign."""


class Generated:
    """Makes values.

    Args:
        random: random numbers.
        wrong: probability that a value is of another type or in another unit.
    """

    def __init__(self, random: np.random.Generator, wrong: float) -> None:
        self._random, self._wrong = random, wrong

    def document(self, kind: Any, given: float = 0.3) -> dict[str, Any]:
        """Make the values of a model or dataclass; one without a default is always given.

        Args:
            kind: the class.
            given: probability of each of the others.
        """
        hints = _hints(kind)
        made: dict[str, Any] = {}
        for name, default in _defaults(kind).items():
            if default is _MISSING or self._random.random() < given:
                made[name] = self.value(hints[name], default)
        if self._random.random() < self._wrong / 10:
            made["unknwon"] = 1
        return made

    def value(self, hint: Any, default: Any = None) -> Any:
        """Make a value for a type.

        Args:
            hint: the type, with its marks.
            default: value that numbers are often near.
        """
        if self._random.random() < self._wrong:
            return self._one(WRONG)
        kind: Any = hint
        marks: list[Any] = []
        if get_origin(hint) is Annotated:
            kind, *marks = get_args(hint)
        bounds = [mark for mark in marks if isinstance(mark, Bounded)]
        if bounds:
            return self._number(bounds[0], kind, default)
        if get_origin(kind) in (Union, types.UnionType):
            return self.value(self._one(get_args(kind)), default)
        if get_origin(kind) is Literal:
            return self._one(get_args(kind))
        if get_origin(kind) is tuple:
            return self._several(get_args(kind))
        if isinstance(kind, type) and (
            issubclass(kind, BaseModel) or dataclasses.is_dataclass(kind)
        ):
            return self.document(kind)
        return self._plain(kind)

    def _number(self, bound: Bounded, kind: Any, default: Any) -> Any:
        """Make a number: near the default, anywhere, at an end, beyond it, or in another unit."""
        low, high = bound.low, bound.high
        usual = isinstance(default, int | float) and not isinstance(default, bool)
        chance = self._random.random()
        if chance < 0.75:
            base = default if usual else exp((log(max(low, 1e-3 * high)) + log(high)) / 2)
            made = float(base) * self._random.lognormal(0.0, 0.2)
        elif chance < 0.9:
            made = self._random.uniform(low, high)
            if low > 0 or (low == 0 and self._random.random() < 0.5):
                made = exp(self._random.uniform(log(max(low, 1e-6 * high)), log(high)))
        else:
            made = float(self._one((low, high)))
        made = min(max(made, low), high)
        if self._random.random() < self._wrong:
            made *= self._one(UNITS)
        if self._random.random() < self._wrong:
            made = self._one((np.nextafter(low, -inf), np.nextafter(high, inf), 2 * high + 1))
        if kind is int or (kind is not float and int in get_args(kind)):
            return round(made)
        return round(made) if made == round(made) and self._random.random() < 0.5 else float(made)

    def _several(self, parts: tuple[Any, ...]) -> list[Any]:
        if parts[1:] == (Ellipsis,):
            count = int(self._random.choice([0, 1, 1, 2, 3]))
            if self._random.random() < self._wrong / 10:
                count = 300
            return [self.value(parts[0]) for _ in range(count)]
        made = [self.value(part) for part in parts]
        return made[:-1] if self._random.random() < self._wrong else made

    def _plain(self, kind: Any) -> Any:
        if kind is bool:
            return bool(self._random.random() < 0.5)
        if kind is str:
            return self._one(("", "a line", "x" * 150, "é ü"))
        if kind is int:
            return int(self._random.integers(-3, 700))
        if kind is float:
            return float(self._random.normal())
        if kind in (types.NoneType, None):
            return None
        return str(kind) if kind is Path else self._one(WRONG)

    def _one(self, choices: Any) -> Any:
        return choices[int(self._random.integers(len(choices)))]


_MISSING = object()


@cache
def _hints(kind: Any) -> dict[str, Any]:
    """Return the types of the fields of a class, with their marks."""
    return get_type_hints(kind, include_extras=True)


def _defaults(kind: Any) -> dict[str, Any]:
    """Return the default of each field of a class; `_MISSING` where there is none."""
    if issubclass(kind, BaseModel):
        return {
            name: _MISSING if field.is_required() else field.get_default(call_default_factory=True)
            for name, field in kind.model_fields.items()
        }
    return {
        field.name: _MISSING if field.default is dataclasses.MISSING else field.default
        for field in dataclasses.fields(kind)
    }
