"""What simulated rigs are made from, and what remains of them when they are closed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from endolock.hw.api import ConfigError
from endolock.twin.hil.hil_rig import HilRig
from endolock.twin.rig import TwinRig
from endolock.twin.surrogate import SurrogateRig

RIGS = [TwinRig, SurrogateRig, HilRig]
AnyRig = type[TwinRig | SurrogateRig | HilRig]


@pytest.mark.parametrize("make", RIGS)
@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        ({"instrument": "slack"}, "'slack' is not of the class Instrument; load one with endolock"),
        ({"seed": "a"}, "seed 'a'; use a whole number, 0 or more"),
        ({"seed": 1.5}, "seed 1.5; use a whole number"),
        ({"seed": True}, "seed True; use a whole number"),
        ({"seed": -1}, "seed -1; use a whole number"),
        ({"seed": None}, "seed None; use a whole number"),
    ],
)
def test_a_wrong_argument_is_refused_in_one_line(
    make: AnyRig, arguments: dict[str, Any], why: str
) -> None:
    with pytest.raises(ConfigError, match=why):
        make("rest", **arguments)


def test_numerics_are_an_object() -> None:
    with pytest.raises(ConfigError, match="'fast' is not of the class Numerics; make one and give"):
        TwinRig("rest", numerics="fast")  # type: ignore[arg-type]  # on purpose


def test_a_seed_may_be_a_numpy_integer() -> None:
    with SurrogateRig("rest", seed=np.int64(3)) as rig:  # type: ignore[arg-type]  # a user may
        assert type(rig.seed) is int


@pytest.mark.parametrize("make", RIGS)
def test_a_closed_rig_does_not_run_on(make: AnyRig) -> None:
    options = {} if make is SurrogateRig else {"pictures": False}
    with make("rest", **options) as rig:  # type: ignore[arg-type]
        rig.clock.sleep_until(0.1)
    with pytest.raises(ConfigError, match="this rig is closed; make a new one"):
        rig.clock.sleep_until(0.2)
    rig.close()  # twice is no mistake
