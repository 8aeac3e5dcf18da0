"""Values of files, believed only if their type is right and they lie in a plausible range.

    class Video(Strict):
        latency_s: Annotated[float, bounded(0, 10, "s")] = 0.4

An integer may stand for a real number; true, "640" or 1.0 for an integer may not.
"""

from __future__ import annotations

from dataclasses import MISSING, dataclass, fields
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast, get_type_hints

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    create_model,
    model_validator,
)
from pydantic_core import CoreSchema, core_schema

from endolock.hw.errors import ConfigError

Kind = TypeVar("Kind")
AnyPath = Annotated[Path, Field(strict=False)]
"""A path, which files give as text."""


class Strict(BaseModel):
    """Values of one part of a file: frozen, of the right type, finite; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _frozen_arrays(cls, values: Any) -> Any:
        if isinstance(values, dict):
            return {key: frozen(value) for key, value in values.items()}
        return values


def frozen(value: Any) -> Any:
    """Return an array of a file as a tuple, and so all arrays in it; other values as they are."""
    return tuple(frozen(part) for part in value) if isinstance(value, list | tuple) else value


def strictly(kind: type[Kind], values: Any) -> Kind:
    """Make an object of a dataclass from the values of a file, believed as those of `Strict`.

    Args:
        kind: the dataclass.
        values: what the file says.

    Raises:
        ValidationError: they are not believed.
    """
    return kind(**dict(model_of(cast(Any, kind), Strict).model_validate(values)))


@cache
def model_of(kind: Any, base: type[Strict]) -> type[Strict]:
    """Return a model with the fields of a dataclass.

    Args:
        kind: the dataclass.
        base: base class of the model.
    """
    hints = get_type_hints(kind, include_extras=True)
    rows: Any = {
        p.name: (hints[p.name], ... if p.default is MISSING else p.default) for p in fields(kind)
    }
    return create_model(kind.__name__, __base__=base, **rows)


@dataclass(frozen=True)
class Bounded:
    """A range that a number must lie in, both ends included; see `bounded`."""

    low: float
    high: float
    unit: str
    hint: str

    def check(self, value: float) -> float:
        """Return a value that lies in the range.

        Raises:
            ConfigError: it does not.
        """
        if self.low <= value <= self.high:
            return value
        unit = f" {self.unit}" if self.unit else ""
        given, low, high = (_number(number) for number in (value, self.low, self.high))
        if given in (low, high):  # just outside
            given = shown(value)
        raise ConfigError(
            f"got {given}{unit}, wanted {low} to {high}{unit}",
            self.hint or f"give a number in this range{f', in {self.unit}' if unit else ''}",
        )

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        number: Any = dict(handler(source))
        if number["type"] in ("float", "int"):  # strict in classes that are not, too
            number["strict"] = True
        if number["type"] == "float":
            number["allow_inf_nan"] = False
        return core_schema.no_info_after_validator_function(self.check, number)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return handler(schema) | {"minimum": self.low, "maximum": self.high}


def bounded(low: float, high: float, unit: str = "", *, hint: str = "") -> Bounded:
    """Return the mark of a number with a plausible range, for use in `Annotated`.

    Args:
        low: least value.
        high: largest value.
        unit: unit of all of them, for people; empty for a plain number.
        hint: what to do about a value outside; by default, give one in the range.
    """
    return Bounded(low, high, unit, hint)


def shown(value: Any) -> str:
    """Return a value as people write it in a file, on one line and not too long."""
    if isinstance(value, bool):
        return str(value).lower()
    try:
        text = repr(value)
    except ValueError:  # Python prints no integer of more than 4300 digits
        return "a very long value"
    return shortened(text)


def shortened(text: str, length: int = 80) -> str:
    """Return a text, its end left out if it is longer than a number of characters."""
    return text if len(text) <= length else f"{text[: length - 3]}..."


def _number(value: float) -> str:
    return f"{value:.10g}" if abs(value) < 1e300 else shown(value)
