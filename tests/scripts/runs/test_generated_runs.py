"""Generated scenarios, instruments, variations, settings: each runs or is refused in one line."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator, Mapping
from math import isfinite
from typing import Any

import numpy as np
import pytest
from tests.generated import Generated

from endolock.control import loop, metrics, registry
from endolock.hw.api import ConfigError, EndolockError, HardwareError
from endolock.scripts.runs import overrides
from endolock.twin.rig import TwinRig
from endolock.twin.world import scenario
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.scenario import Scenario
from endolock.vision.truth_eyes import TruthEyes

REST = scenario.load("rest")
KEYS = ("gravity", "camera.latency", "camera.latency_s", "motion.0", "board", "x.y", "", ".", "law")
RUN_S = 0.2
"""Length of a run [s]: ten ticks and five frames; what a time step does not resolve diverges within
some steps."""


def task(seed: int, wrong: float) -> overrides.Task:
    """Make a scenario, an instrument and the settings of a controller from generated values."""
    random = np.random.default_rng(seed)
    made = Generated(random, wrong)
    values = made.document(Scenario)
    del values["name"]
    entries = [f"instrument.{name}={_toml(v)}" for name, v in made.document(Instrument).items()]
    law = registry.LAWS["pi_hc"].settings
    entries += [f"law.{name}={_toml(value)}" for name, value in made.document(law).items()]
    entries += [str(name) for name in random.choice(overrides.names(), 1)]
    if random.random() < wrong:
        entries += [f"{random.choice(KEYS)}={_toml(made.value(float))}"]
    return overrides.apply(REST, "pretensioned", entries, values)


def run(made: overrides.Task, seed: int) -> None:
    """Run a task for a moment; check that its results are finite."""
    settings = registry.configure("pi_hc", made.law)
    world = scenario.load(made.scenario, {"duration_s": RUN_S, "scored_from_s": 0.0})
    with TwinRig(world, instrument=made.instrument, pictures=False, seed=seed) as rig:
        rig.clock.sleep_until(0.0)
        law = registry.make("pi_hc", rig.camera.calibration, settings)
        result = loop.run(rig, TruthEyes(rig.truth), law, duration_s=RUN_S)
        scores = metrics.score(result, rig.camera.calibration, 0.0)
    assert len(result.ticks) == round(RUN_S / loop.PERIOD_S) + 1
    for where, number in _numbers(dataclasses.asdict(scores), "scores"):
        assert isfinite(number), where
    for tick in result.ticks:
        for where, number in _numbers(dataclasses.asdict(tick.state), "state"):
            assert isfinite(number), where


def outcome(seed: int, wrong: float, *, runs: bool) -> str:
    """Return what becomes of a generated task, in a word; a refusal must be one plain line."""
    try:
        made = task(seed, wrong)
        registry.configure("pi_hc", made.law)
        if runs:
            run(made, seed)
    except EndolockError as error:
        refusal = error
    else:
        return "ran"
    # A handle that is too weak for its wires stops, as on a bench.
    assert isinstance(refusal, ConfigError | HardwareError), seed
    assert str(refusal).isprintable(), seed
    assert len(str(refusal)) < 1000, seed
    assert refusal.next_step, (seed, str(refusal))
    return "diverged" if "diverged" in str(refusal) else type(refusal).__name__


def test_generated_values_are_taken_or_refused_in_one_line() -> None:
    right = Counter(outcome(seed, 0.0, runs=False) for seed in range(100))
    wrong = Counter(outcome(seed, 0.02, runs=False) for seed in range(1000, 1200))
    # so many, that both ways are tried
    assert right["ran"] > 30
    assert wrong["ConfigError"] > 60
    assert right.total() == 100
    assert set(right) | set(wrong) == {"ran", "ConfigError"}


def test_generated_runs_have_finite_results() -> None:
    found = Counter(outcome(seed, 0.0, runs=True) for seed in range(2000, 2010))
    assert found["ran"] >= 3


@pytest.mark.slow
def test_two_thousand_generated_runs_have_finite_results() -> None:
    first = int(np.random.SeedSequence().generate_state(1)[0])
    print(f"seeds from {first} on")
    found = Counter(outcome(first + n, 0.01 * (n % 2), runs=True) for n in range(2000))
    print(found)
    assert found["ran"] > 500


def _numbers(value: Any, where: str) -> Iterator[tuple[str, float]]:
    """Yield all real numbers within a value, with their names."""
    if isinstance(value, float):
        yield where, value
    elif isinstance(value, Mapping):
        for key, part in value.items():
            yield from _numbers(part, f"{where}.{key}")
    elif isinstance(value, list | tuple):
        for n, part in enumerate(value):
            yield from _numbers(part, f"{where}.{n}")


def _toml(value: Any) -> str:
    """Write a value as people do after KEY=."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and abs(value) > 10**300:
        return f"1{'0' * 400}"
    return str(value)
