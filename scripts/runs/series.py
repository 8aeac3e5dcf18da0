"""Several experiments one after another, up to an interruption."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from endolock.scripts.runs.experiment import Experiment, Interrupted
from endolock.scripts.runs.run_record import RunRecord


class Series(NamedTuple):
    """Records of experiments run one after another."""

    records: list[RunRecord]
    """One per run, including an interrupted one."""
    stopped: Interrupted | None
    """The interruption that ended the series early; None if it is complete."""

    def conclude(self) -> None:
        """Raise the interruption, if any; call it after reporting the results."""
        if self.stopped:
            raise self.stopped


def run_all(experiments: Sequence[Experiment], *, show_progress: bool = True) -> Series:
    """Run experiments one after another, until a Ctrl-C.

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
            when = f"in run {n} of {total}, after {stop.record.duration_s:.1f} s"
            return Series(records, Interrupted(stop.record, when))
    return Series(records, None)
