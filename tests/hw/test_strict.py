"""Values of files: which types and numbers are believed, and what is said of the others."""

from __future__ import annotations

from math import inf, nan
from typing import Annotated, Any

import pytest
from pydantic import ValidationError

from endolock.hw import files
from endolock.hw.strict import AnyPath, Strict, bounded, shown


class Video(Strict):
    """A part of a file."""

    latency_s: Annotated[float, bounded(0, 10, "s", hint="give seconds")] = 0.4
    rate_hz: Annotated[float, bounded(0.1, 1000, "Hz")] | None = None
    skipped: Annotated[int, bounded(0, 8)] = 0
    flipped: bool = False
    name: str = ""
    file: AnyPath | None = None
    spans: tuple[tuple[Annotated[float, bounded(-1, 1, "rad")], float], ...] = ()


@pytest.mark.parametrize(
    "values",
    [
        {"latency_s": 1, "rate_hz": 25, "skipped": 8},
        {"spans": [[0, 2], [-1.0, 1e9]]},
        {"file": "a.toml", "name": "b", "flipped": True},
    ],
)
def test_what_is_right_is_taken(values: dict[str, Any]) -> None:
    assert Video.model_validate(values)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"latency_s": 380}, "latency_s: got 380 s, wanted 0 to 10 s; give seconds"),
        ({"latency_s": True}, "latency_s: should be a valid number, got true"),
        ({"latency_s": "0.4"}, "latency_s: should be a valid number, got '0.4'"),
        ({"latency_s": nan}, "latency_s: should be a finite number, got nan"),
        ({"latency_s": -inf}, "latency_s: should be a finite number, got -inf"),
        ({"rate_hz": 0}, "rate_hz: got 0 Hz, wanted 0.1 to 1000 Hz; give a number in this range"),
        ({"skipped": 1.0}, "skipped: should be a valid integer, got 1.0"),
        ({"skipped": True}, "skipped: should be a valid integer, got true"),
        ({"skipped": 10**400}, f"skipped: got 1{76 * '0'}..., wanted 0 to 8"),
        ({"flipped": 1}, "flipped: should be a valid boolean, got 1"),
        ({"name": 5}, "name: should be a valid string, got 5"),
        ({"file": True}, "file: Input is not a valid path"),
        ({"spans": [[2, 0]]}, "spans.0.0: got 2 rad, wanted -1 to 1 rad"),
        ({"spans": [[True, 0]]}, "spans.0.0: should be a valid number, got true"),
        ({"flip": True}, "unknown key flip"),
        ({"name": ["x" * 200]}, "name: should be a valid string"),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(values: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Video.model_validate(values)
    what, next_step = files.first_problem(caught.value, lambda _: list(Video.model_fields))
    line = f"{what}; {next_step}"
    assert line.startswith(said)
    assert "\n" not in line
    assert len(line) < 200


def test_the_range_is_in_the_schema() -> None:
    assert Video.model_json_schema()["properties"]["latency_s"]["maximum"] == 10


@pytest.mark.parametrize(("value", "text"), [(True, "true"), (0.1, "0.1"), ("a\nb", "'a\\nb'")])
def test_values_are_shown_as_people_write_them(value: Any, text: str) -> None:
    assert shown(value) == text
