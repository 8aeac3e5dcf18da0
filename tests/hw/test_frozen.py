"""Records whose fields cannot change, whatever they were made from."""

from __future__ import annotations

import pickle
from dataclasses import FrozenInstanceError, dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from endolock.hw.api import Calibration, Frame, Image, Plant, Pose, State, Vector
from endolock.hw.frozen import Frozen, read_only


@dataclass(frozen=True, kw_only=True)
class Record(Frozen):
    """One field of any kind."""

    value: Any


def test_what_a_record_is_made_from_may_change_afterwards() -> None:
    numbers, listed = np.array([1.0, 2.0]), [1.0, [2.0]]
    named: dict[str, Any] = {"a": [1.0]}
    made = [Record(value=value) for value in (numbers, listed, named, (numbers, listed))]
    numbers += 1
    listed[1] = named["b"] = 5.0
    named["a"].append(2.0)
    assert made[0].value == (1.0, 2.0)
    assert made[1].value == (1.0, (2.0,))
    assert made[2].value == MappingProxyType({"a": (1.0,)})
    assert made[3].value == ((1.0, 2.0), (1.0, (2.0,)))


@pytest.mark.parametrize("copied", [False, True])
def test_a_record_cannot_be_written(copied: bool) -> None:
    image: Image = np.zeros((4, 5, 3), np.uint8)
    made: list[Any] = [
        Record(value=np.ones((2, 3))),
        Record(value={"a": 1.0}),
        Frame(image=image, t_capture=0, t_available=0, seq=0, dropped=0),
    ]
    if copied:  # as from another process
        made = pickle.loads(pickle.dumps(made))
    array, mapping, frame = made[0].value, made[1].value, made[2].image
    with pytest.raises(ValueError, match="read-only"):
        array[0, 0] = 2.0
    with pytest.raises(ValueError, match="cannot set WRITEABLE"):
        array.flags.writeable = True  # a copy of bytes, for good
    with pytest.raises(TypeError):
        mapping["a"] = 2.0
    with pytest.raises(ValueError, match="read-only"):
        frame[0, 0, 0] = 1
    with pytest.raises(FrozenInstanceError):
        made[0].value = 1
    assert image.flags.writeable  # a picture is not copied; its owner keeps its buffer


def test_a_view_is_made_read_only_with_its_owner() -> None:
    owner: Vector = np.zeros((3, 4))
    read_only(owner[:, ::2])
    assert not owner.flags.writeable


def test_records_of_the_seam_take_lists_and_arrays() -> None:
    calibration = Calibration(width=4, height=3, focal_px=2.0, centre_px=[1.5, 1.0])  # type: ignore[arg-type]
    assert hash(calibration)
    position = np.array([0.5, 0.25, 0.125])
    pose = Pose(t=0.0, position=position, quaternion=[1.0, 0.0, 0.0, 0.0])  # type: ignore[arg-type]
    position += 1
    assert pose.position == (0.5, 0.25, 0.125)
    assert issubclass(State, Frozen)
    assert issubclass(Plant, Frozen)
