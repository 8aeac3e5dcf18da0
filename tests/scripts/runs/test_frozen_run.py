"""Nothing that a run hands out can be used to change the plant, other readers or the log."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from endolock import Command, Experiment, Frame, Observation, TruthEyes, TwinRig, read_run
from endolock.control.loop import Seen, Tick
from endolock.hw.api import Rig, State
from endolock.hw.lifecycle import ClosingRig
from endolock.twin.hil.hil_rig import HilRig
from endolock.twin.surrogate import SurrogateRig
from endolock.twin.world import scenario as scenarios

READ = ("matrix", "rotation_vector")
"""Properties that make arrays."""


def parts(value: Any) -> Iterator[Any]:
    """Yield a value and all that is reachable from it, arrays under views included."""
    yield value
    if isinstance(value, np.ndarray):
        if value.base is not None:
            yield from parts(value.base)
    elif is_dataclass(value):
        for name in (*(field.name for field in fields(value)), *READ):
            if hasattr(value, name):
                yield from parts(getattr(value, name))
    elif isinstance(value, dict | list | tuple):
        for part in value.values() if isinstance(value, dict) else value:
            yield from parts(part)


def spoil(value: Any) -> int:
    """Try to write into everything reachable; return how many arrays were met."""
    arrays = 0
    for part in parts(value):
        with contextlib.suppress(TypeError, ValueError, AttributeError):
            if isinstance(part, np.ndarray):
                arrays += 1
                part[...] = 77
            elif isinstance(part, list) or hasattr(part, "keys"):
                part.clear()
            elif is_dataclass(part):
                for field in fields(part):
                    setattr(part, field.name, 77)
    return arrays


class Vandal:
    """Law, eyes and recorder in one, which write into all that they get."""

    def __init__(self, rig: Rig, spoils: Callable[[Any], int]) -> None:
        self.rig, self.spoil = rig, spoils
        self.arrays = self.updates = 0
        self.signals = {"a": 1.0}
        self._eyes = TruthEyes(rig.truth) if rig.truth else None

    def reset(self, state: State) -> None:
        """Spoil the state."""
        self.spoil(state)

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Spoil the state, the past, the truth and the properties of the rig."""
        rig, goal = self.rig, 0.1 * min(t, 1.0)
        self.updates += 1
        assert rig.truth
        assert rig.tracker
        truth = rig.truth.now()
        handed_out = [
            state,
            observation,
            truth,
            rig.actuators.history(state.t),
            rig.actuators.limits,
            rig.camera.calibration,
            rig.board,
            rig.board.corners(),
            rig.describe(),
            rig.tracker.latest(),
            rig.camera.latest(),
            rig.overview.latest() if rig.overview else None,
        ]
        for thing in handed_out:
            self.arrays += self.spoil(thing)
        return Command(position=[goal, -goal])

    def __call__(self, frame: Frame) -> Observation:
        """Look, and spoil the frame and the truth of its exposure."""
        assert self._eyes
        assert self.rig.truth
        seen = self._eyes(frame)
        self.arrays += self.spoil(frame) + self.spoil(self.rig.truth.at_exposure(frame.seq))
        return seen


def play(rig: ClosingRig, out: Path, spoils: Callable[[Any], int]) -> Vandal:
    """Run a vandal on a rig into a run folder."""
    with rig:
        law = Vandal(rig, spoils)  # type: ignore[arg-type]  # each is a Rig
        Experiment(
            scenario=rig.scenario,  # type: ignore[attr-defined]
            rig=rig,  # type: ignore[arg-type]
            controller=law,
            vision=law,
            out=out,
        ).run()
    return law


def tracked() -> Any:
    """Return the scenario `rest` with a pose tracker and a small picture."""
    return scenarios.load(
        "straight",
        {
            "duration_s": 0.5,
            "scored_from_s": 0.25,
            "camera.latency_s": 0.1,
            "camera.width": 160,
            "camera.height": 120,
            "tracker.rate_hz": 100.0,
        },
    )


@pytest.mark.parametrize(("make", "pictures"), [(TwinRig, True), (HilRig, False)])
def test_a_run_that_is_written_into_everywhere_has_the_same_log(
    make: type[TwinRig | HilRig], pictures: bool, tmp_path: Path
) -> None:
    def rig() -> TwinRig | HilRig:
        return make(tracked(), pictures=pictures, overview=pictures)

    play(rig(), tmp_path / "honest", lambda thing: 0)
    law = play(rig(), tmp_path / "spoiled", spoil)
    assert law.updates == 26
    assert law.arrays > 25  # a backbone at each update at least
    honest, spoiled = (read_run(tmp_path / name) for name in ("honest", "spoiled"))
    assert spoiled.ticks.equals(honest.ticks)
    assert spoiled.frames.equals(honest.frames)


class Spoiler:
    """A recorder that writes into what it gets."""

    def tick(self, tick: Tick) -> None:
        """Spoil a tick."""
        spoil(tick)

    def seen(self, seen: Seen) -> None:
        """Spoil a frame."""
        spoil(seen)


def test_a_recorder_cannot_change_the_run_in_memory() -> None:
    from endolock import run  # the loop itself

    def ticks(recorder: Spoiler | None) -> list[Tick]:
        with SurrogateRig("straight") as rig:
            law = Holding()
            return run(rig, TruthEyes(rig.truth), law, duration_s=0.3, recorder=recorder).ticks

    assert [repr(tick) for tick in ticks(Spoiler())] == [repr(tick) for tick in ticks(None)]


class Holding:
    """Holds, and says so."""

    def __init__(self) -> None:
        self.signals = {"zero": 0.0}

    def reset(self, state: State) -> None:
        """Nothing to forget."""

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Hold."""
        return Command(position=(0.0, 0.0))


def test_what_an_experiment_is_made_from_may_change_afterwards(tmp_path: Path) -> None:
    vary, select = ["law.ki=1.0"], [1, 2, 30, 30]
    changes: dict[str, Any] = {"duration_s": 0.5}
    scenario = scenarios.load("straight", changes)
    experiment = Experiment(
        scenario=scenario,
        vary=vary,  # type: ignore[arg-type]  # a user may
        select=select,  # type: ignore[arg-type]
        out=tmp_path / "run",
    )
    vary.append("law.kp=9.0")
    select[0] = 99
    changes["duration_s"] = 99.0
    assert experiment.vary == ("law.ki=1.0",)
    assert experiment.select == (1, 2, 30, 30)
    assert experiment.resolve().scenario.duration_s == 0.5
    experiment.resolve().changes["duration_s"] = 99.0  # a copy of its own
    assert experiment.resolve().scenario.duration_s == 0.5
