"""Acceptance tests of the predictive lock on the twin; long, so part of ./run slow."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from endolock.scripts.runs import batch, theory
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.studies import ensemble
from endolock.twin.world import scenario

pytestmark = pytest.mark.slow
LAW = "predictive_bank"


def record(name: str, place: Path, vision: str = "truth", **changes: Any) -> dict[str, Any]:
    request = Experiment(
        scenario=name,
        controller=changes.pop("law", LAW),
        vision=vision,
        duration_s=100.0,
        scored_from_s=50.0,
        out=place / "run",
        **changes,
    )
    return request.run().as_dict()


@pytest.mark.parametrize(
    ("name", "gates"),
    [
        ("straight", {"rms": 10, "p95": 20, "max": 40}),
        ("circle", {"rms": 12}),
        ("triangle", {"rms": 20}),
    ],
)
def test_with_pictures_and_markers(name: str, gates: dict[str, float], tmp_path: Path) -> None:
    scores = record(name, tmp_path, "markers")
    for what, most in gates.items():
        assert scores["error_px"][what] <= most, what
    assert scores["time_to_lock_s"] <= 15.0  # from a cold start


@pytest.mark.parametrize("name", ["straight", "circle"])
def test_twenty_unknown_plants(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ensemble, "SCENARIOS", (name,))
    runs = ensemble.perform(LAW)[name]
    assert max(one.rms for one in runs) <= {"straight": 20, "circle": 25}[name]
    # One or two frames may be lost at the start; more means that the target was not found again.
    assert max(one.lost for one in runs) < 0.01


def test_a_random_target_within_twice_the_floor(tmp_path: Path) -> None:
    rms = [
        record("random", tmp_path / str(seed), seed=seed)["error_px"]["rms"] for seed in range(5)
    ]
    floor = theory.floor_px(scenario.load("random"))
    assert floor is not None
    assert np.mean(rms) <= 2 * floor


def test_twice_the_latency_is_better_than_a_tuned_pi_without_any(tmp_path: Path) -> None:
    late = record("straight", tmp_path / "late", latency_s=0.8)
    prompt = record("straight", tmp_path / "prompt", law="pi_simc", latency_s=0.0)
    assert late["error_px"]["rms"] < prompt["error_px"]["rms"]


def test_at_a_short_distance_the_target_stays_locked(tmp_path: Path) -> None:
    scores = record("close", tmp_path)
    assert scores["error_px"]["rms"] <= 15.0
    assert scores["lost_fraction"] == 0.0


def test_at_rest_error_and_handle_motion_are_small(tmp_path: Path) -> None:
    scores = record("rest", tmp_path, "markers")
    assert scores["error_px"]["rms"] <= 1.0
    assert scores["handle"]["reversals_per_s"] <= 0.5


@pytest.mark.parametrize("name", scenario.names())
def test_never_worse_than_a_tuned_pi(name: str) -> None:
    asked = [
        Experiment(
            scenario=name,
            controller=law,
            vision="truth",
            duration_s=100.0,
            scored_from_s=50.0,
            seed=seed,
        )
        for law in (LAW, "pi_simc")
        for seed in range(5)
    ]
    rms = [one.rms for one in batch.all_of(asked)]
    assert np.mean(rms[:5]) <= 1.05 * np.mean(rms[5:]) + 1.0
