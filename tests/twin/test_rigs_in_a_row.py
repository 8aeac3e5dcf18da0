"""Rigs that were closed and forgotten leave nothing behind, without the garbage collector."""

import gc
import os
import weakref
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from endolock import ConfigError, HilRig, SurrogateRig, TwinRig
from endolock.twin.env import target_lock


@pytest.fixture(autouse=True)
def no_collector() -> Iterator[None]:
    gc.disable()
    yield
    gc.enable()


def resident_mb() -> float:
    """Memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def with_pictures() -> TwinRig:
    return TwinRig("straight", overview=True)


MAKERS: dict[str, Callable[[], Any]] = {
    "truth": partial(TwinRig, "straight", pictures=False),
    "pictures": with_pictures,
    "surrogate": partial(SurrogateRig, "straight"),
    "hil": partial(HilRig, "straight", pictures=False),
    "environment": target_lock.make,
}


def used(kind: str) -> "weakref.ref[Any]":
    """Make a rig or an environment, use it, and close it."""
    rig = MAKERS[kind]()
    if isinstance(rig, target_lock.Environment):
        rig.reset()
        rig.step([0.1, 0.0])
        rig.close()
    else:
        with rig:
            rig.actuators.enable()
            rig.clock.sleep_until(0.1)
    return weakref.ref(rig)


@pytest.mark.parametrize("kind", MAKERS)
def test_a_closed_rig_is_freed_with_its_last_reference(kind: str) -> None:
    assert used(kind)() is None


def test_thirty_rigs_need_the_memory_of_one() -> None:
    used("truth")
    used("truth")
    before = resident_mb()
    for _ in range(30):
        used("truth")
    # 250 MB where the models of closed rigs stay; the rest is what the allocator keeps.
    assert resident_mb() - before < 25


@pytest.mark.slow
@pytest.mark.parametrize("kind", MAKERS)
def test_200_rigs_stay_within_50_mb(kind: str) -> None:
    for _ in range(4):
        used(kind)
    before = resident_mb()
    for _ in range(200):
        used(kind)
    assert resident_mb() - before < 50


@pytest.mark.parametrize("kind", ["truth", "surrogate"])
def test_the_clock_of_a_closed_rig_still_tells_the_time_and_does_not_run(kind: str) -> None:
    rig = MAKERS[kind]()
    with rig:
        rig.clock.sleep_until(0.1)
    clock = rig.clock
    assert clock.now() == pytest.approx(0.1)
    del rig
    with pytest.raises(ConfigError, match="this rig is closed; make a new one"):
        clock.sleep_until(0.2)
    assert clock.now() == pytest.approx(0.1)
