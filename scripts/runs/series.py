"""Several experiments one after another, up to an interruption."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from endolock.scripts.runs.experiment import Experiment, Interrupted
from endolock.scripts.runs.run_record import RunRecord


class Series(NamedTuple):
    """Runs one after another."""

    records: list[RunRecord]
    """Of all runs, also of one that was ended early."""
    stopped: Interrupted | None
    """What ended the series early."""

    def conclude(self) -> None:
        """Raise what ended the series early; called once its results have been reported."""
        if self.stopped:
            raise self.stopped


def run_all(experiments: Sequence[Experiment], *, show_progress: bool = True) -> Series:
    """Carry out experiments one after another, up to a Ctrl-C.

    Raises:
        ConfigError, HardwareError: as for `Experiment.run`.
    """
    records: list[RunRecord] = []
    total = len(experiments)
    for n, experiment in enumerate(experiments, 1):
        label = f"{n}/{total}" if total > 1 else ""
        try:
            records.append(experiment.run(label=label, show_progress=show_progress))
        except Interrupted as stop:
            records.append(stop.record)
            if total == 1:
                return Series(records, stop)
            how_far = f"in run {n} of {total}, after {stop.record.duration_s:.1f} s"
            return Series(records, Interrupted(stop.record, how_far))
    return Series(records, None)
