"""Many runs at once, in two processes: their records, and the course of error and handles."""

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
from endolock.scripts.runs import run_folder
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.run_record import RunRecord

WORKERS = 2
FOLLOWED = (0.5, 1.5)
"""A tip follows if its motion is within these shares of what the path needs [1]: below them it is
parked, above them it rings. Assumed."""
LEAST_NEED_DEG = 1.0
"""An axis that needs less is not asked to follow [deg]."""
Made = TypeVar("Made")


class Done(NamedTuple):
    """One run."""

    record: RunRecord
    t: Vector
    """Times of the ticks, n [s]."""
    error: Vector
    """True offset of the target, n x 2, right and down [px]."""
    handle: Vector
    """Measured handle angles, n x 2 [rad]."""

    @property
    def rms(self) -> float:
        """Of the true error where it is scored [px]."""
        return _known(_known(self.record.error_px).rms)

    @property
    def lost(self) -> float:
        """Share of the ticks without a lock [1]."""
        return _known(self.record.lost_fraction)

    @property
    def tip_deg(self) -> float:
        """Motion of the tip from peak to peak where it is scored, of the axis that moved more."""
        return max(_known(_known(self.record.tip).p2p_deg))

    @property
    def needed_deg(self) -> float:
        """The same of a tip that always points at the target."""
        return max(_known(self.record.needed_tip_deg))

    @property
    def follows(self) -> bool:
        """Whether the tip moves on each axis about as far as the path needs, never losing it."""
        low, high = FOLLOWED
        moved = _known(_known(self.record.tip).p2p_deg)
        needed = _known(self.record.needed_tip_deg)
        return self.lost < 0.01 and all(
            low * need <= moves <= high * need
            for moves, need in zip(moved, needed, strict=True)
            if need >= LEAST_NEED_DEG
        )

    @property
    def constant_px(self) -> float:
        """Error that the best constant handle would leave, known in hindsight, rms [px]."""
        return _known(_known(self.record.constant_px).rms)

    @property
    def handle_deg(self) -> float:
        """Motion of the handle from peak to peak, as of the tip."""
        return max(_known(self.record.handle.p2p_deg))

    @property
    def distance(self) -> Vector:
        """Of the target from the centre [px]."""
        distance: Vector = np.hypot(*self.error.T)
        return distance


def perform(experiments: Sequence[Experiment]) -> list[Done | None]:
    """Carry out runs.

    Args:
        experiments: what to run; their folders are not kept.

    Returns:
        The runs, None where a law cannot be used on a task.
    """
    return each(experiments, _course)


def each(
    experiments: Sequence[Experiment], read: Callable[[RunRecord, Path], Made]
) -> list[Made | None]:
    """Carry out runs, and keep of each what a function reads from its record and run folder.

    Args:
        experiments: what to run; their folders are not kept.
        read: called in another process, so it must be importable.

    Returns:
        What was read, None where a law cannot be used on a task.
    """
    with multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
        return pool.map(partial(_one, read=read), experiments, chunksize=1)


def all_of(experiments: Sequence[Experiment]) -> list[Done]:
    """Carry out runs, all of which must be possible."""
    return each_of(experiments, _course)


def each_of(
    experiments: Sequence[Experiment], read: Callable[[RunRecord, Path], Made]
) -> list[Made]:
    """As `each`, for runs all of which must be possible."""
    made = [one for one in each(experiments, read) if one is not None]
    assert len(made) == len(experiments)
    return made


def _known(value: Made | None) -> Made:
    """Return a score that every simulated run has."""
    assert value is not None
    return value


def _one(experiment: Experiment, read: Callable[[RunRecord, Path], Made]) -> Made | None:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"
        try:
            record = replace(experiment, out=folder).run()
        except ConfigError:  # such as repetitive, where nothing repeats
            return None
        return read(record, folder)


def _course(record: RunRecord, folder: Path) -> Done:
    ticks = run_folder.read(folder, "ticks")
    centre = run_folder.configuration(folder)["calibration"]["centre_px"]
    columns = (ticks[name].to_pylist() for name in ("target_px", "position_rad"))
    target, handle = (np.array(column, float) for column in columns)
    return Done(record, np.array(ticks["t"]), target - centre, handle)
