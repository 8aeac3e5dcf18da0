"""Fields of dataclasses: checked as strictly as values of files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, nan
from typing import Annotated, Any, Literal

import numpy as np
import pytest

from endolock.hw.errors import ConfigError
from endolock.hw.strict import bounded
from endolock.hw.strict_fields import settle


@dataclass(frozen=True, kw_only=True)
class Inner:
    """A part."""

    radii: tuple[Annotated[float, bounded(0, 1, "rad")], ...] = (0.5,)

    def __post_init__(self) -> None:
        settle(self, "inner")


@dataclass(frozen=True, kw_only=True)
class Made:
    """An object of which each field has a kind of its own."""

    kp: Annotated[float, bounded(0, 10, "rad/rad")] = 0.5
    points: Annotated[int, bounded(1, 9)] = 1
    fast: bool = False
    form: Literal["sign", "play"] = "sign"
    inner: Inner = Inner()

    def __post_init__(self) -> None:
        settle(self, "made")


@pytest.mark.parametrize(
    "values",
    [
        {"kp": 1},
        {"kp": np.float32(1.0)},
        {"kp": np.int64(1), "points": np.int64(1)},
        {"inner": Inner(radii=[0, 1])},  # type: ignore[arg-type]
        {"inner": Inner(radii=(np.float64(0.0), 1.0))},
    ],
)
def test_what_stands_for_a_value_becomes_it(values: dict[str, Any]) -> None:
    made = Made(**values)
    assert type(made.kp) is float
    assert type(made.points) is int
    assert all(type(radius) is float for radius in made.inner.radii)
    assert type(made.inner.radii) is tuple
    assert replace(made) == made
    assert hash(replace(made)) == hash(made)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"kp": 11}, "made: kp: got 11 rad/rad, wanted 0 to 10 rad/rad; give a number in this"),
        ({"kp": 10.000000000000002}, "made: kp: got 10.000000000000002 rad/rad, wanted 0 to 10"),
        ({"kp": True}, "made: kp: should be a valid number, got true"),
        ({"kp": np.bool_(True)}, "made: kp: should be a valid number, got true"),
        ({"kp": "0.5"}, "made: kp: should be a valid number, got '0.5'"),
        ({"kp": None}, "made: kp: should be a valid number, got None"),
        ({"kp": nan}, "made: kp: should be a finite number, got nan"),
        ({"kp": -inf}, "made: kp: should be a finite number, got -inf"),
        ({"kp": 10**400}, "made: kp: should be a valid number, got 1000"),
        ({"kp": np.zeros(3)}, "made: kp: should be a valid number, got array"),
        ({"points": 1.0}, "made: points: should be a valid integer, got 1.0"),
        ({"points": 0}, "made: points: got 0, wanted 1 to 9"),
        ({"fast": 1}, "made: fast: should be a valid boolean, got 1"),
        ({"form": "round"}, "made: form: should be 'sign' or 'play', got 'round'"),
        ({"inner": 3}, "made: inner: "),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(values: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        Made(**values)
    assert str(caught.value).startswith(said)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 250


def test_parts_are_checked_where_they_are_made() -> None:
    with pytest.raises(ConfigError, match=r"inner: radii\.1: got 2 rad, wanted 0 to 1 rad"):
        Inner(radii=(0.0, 2.0))
