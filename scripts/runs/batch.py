"""Runs many experiments in parallel processes; returns records, errors and handle angles."""

from __future__ import annotations

import multiprocessing
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from endolock.hw.api import ConfigError, Vector
from endolock.hw.child_processes import safe_path
from endolock.scripts.runs import run_folder
from endolock.scripts.runs.experiment import Experiment, Interrupted
from endolock.scripts.runs.run_record import RunRecord

WORKERS = 2
FOLLOWED = (0.5, 1.5)
"""Smallest and largest ratio of the tip's motion to the motion that the path needs [1] at which the
tip counts as following: below it is parked, above it rings. Assumed."""
MIN_NEEDED_DEG = 1.0
"""An axis on which the path needs less motion is not checked for following [deg]."""
Result = TypeVar("Result")


class FinishedRun(NamedTuple):
    """Record and signals of one run."""

    record: RunRecord
    t: Vector
    """Times of the ticks, n [s]."""
    error: Vector
    """True offset of the target, n x 2, right and down [px]."""
    handle: Vector
    """Measured handle angles, n x 2 [rad]."""

    @property
    def rms(self) -> float:
        """RMS of the true error over the scored part [px]."""
        return _known(_known(self.record.error_px).rms)

    @property
    def max_px(self) -> float:
        """Largest true error in the scored part [px]."""
        return _known(_known(self.record.error_px).max)

    @property
    def handles(self) -> tuple[float, float, float]:
        """Travel [rad/s], reversals by 0.1 rad [1/s] and share above 2 rad/s [1] of the handles."""
        record, handle = self.record, self.record.handle
        large, fast = _known(handle.large_reversals_per_s), _known(handle.fast_share)
        return _known(record.travel_rad_s), large, fast

    @property
    def lost(self) -> float:
        """Share of the ticks without a lock [1]."""
        return _known(self.record.lost_fraction)

    @property
    def tip_deg(self) -> float:
        """Peak-to-peak tip motion over the scored part, on the axis that moved more [deg]."""
        return max(_known(_known(self.record.tip).p2p_deg))

    @property
    def needed_deg(self) -> float:
        """Peak-to-peak motion of a tip always pointing at the target, on the larger axis [deg]."""
        return max(_known(self.record.needed_tip_deg))

    @property
    def follows(self) -> bool:
        """Whether the tip moves about as far as the path needs on each axis, locked throughout."""
        low, high = FOLLOWED
        moved = _known(_known(self.record.tip).p2p_deg)
        needed = _known(self.record.needed_tip_deg)
        return self.lost < 0.01 and all(
            low * need <= moves <= high * need
            for moves, need in zip(moved, needed, strict=True)
            if need >= MIN_NEEDED_DEG
        )

    @property
    def constant_px(self) -> float:
        """RMS error of the best constant handle angle, known in hindsight [px]."""
        return _known(_known(self.record.constant_px).rms)

    @property
    def handle_deg(self) -> float:
        """Peak-to-peak handle motion over the scored part, on the axis that moved more [deg]."""
        return max(_known(self.record.handle.p2p_deg))

    @property
    def distance(self) -> Vector:
        """Distance of the target from the picture centre [px]."""
        distance: Vector = np.hypot(*self.error.T)
        return distance


def perform(experiments: Sequence[Experiment]) -> list[FinishedRun | None]:
    """Run experiments.

    Args:
        experiments: what to run; their folders are not kept.

    Returns:
        The runs, None where a controller cannot be used on a task.
    """
    return each(experiments, _signals)


def each(
    experiments: Sequence[Experiment], read: Callable[[RunRecord, Path], Result]
) -> list[Result | None]:
    """Run experiments, and keep what a function extracts from each record and run folder.

    Args:
        experiments: what to run; their folders are not kept.
        read: called in another process, so it must be importable.

    Returns:
        The return values of `read`, None where a controller cannot be used on a task.
    """
    with safe_path(), multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
        try:
            return pool.map(partial(_run, read=read), experiments, chunksize=1)
        except _WorkerInterruptedError as stop:
            raise KeyboardInterrupt(str(stop)) from None


def all_of(experiments: Sequence[Experiment]) -> list[FinishedRun]:
    """Run experiments, all of which must be possible."""
    return each_of(experiments, _signals)


def each_of(
    experiments: Sequence[Experiment], read: Callable[[RunRecord, Path], Result]
) -> list[Result]:
    """Run experiments as `each` does, all of which must be possible."""
    results = [result for result in each(experiments, read) if result is not None]
    assert len(results) == len(experiments)
    return results


def _known(value: Result | None) -> Result:
    """Return a score that every simulated run has."""
    assert value is not None
    return value


class _WorkerInterruptedError(Exception):
    """A run in another process was interrupted."""


def _run(experiment: Experiment, read: Callable[[RunRecord, Path], Result]) -> Result | None:
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "run"
        try:
            record = replace(experiment, out=folder).run()
        except Interrupted as stop:  # a pool waits for ever for a worker that ends of it
            raise _WorkerInterruptedError(str(stop)) from None
        except ConfigError:  # such as repetitive on a path that is not periodic
            return None
        return read(record, folder)


def _signals(record: RunRecord, folder: Path) -> FinishedRun:
    ticks = run_folder.read(folder, "ticks")
    centre = run_folder.configuration(folder)["calibration"]["centre_px"]
    columns = (ticks[name].to_pylist() for name in ("target_px", "position_rad"))
    target, handle = (np.array(column, float) for column in columns)
    return FinishedRun(record, np.array(ticks["t"]), target - centre, handle)
