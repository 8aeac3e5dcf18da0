"""Runs a rig, its eyes and a controller into a run folder.

record = Experiment(scenario="circle", controller="predictive_bank", duration_s=100.0).run()
print(record.error_px.rms, record.folder)
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, chdir, nullcontext
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

from endolock.control import loop, metrics, registry, user_law
from endolock.control.loop import Controller
from endolock.hw.api import Calibration, ConfigError, Rig
from endolock.hw.bench.bench_file import Bench
from endolock.hw.lifecycle import close_all
from endolock.scripts.runs import (
    experiment_checks,
    overrides,
    rigs,
    run_folder,
    theory,
)
from endolock.scripts.runs.experiment_checks import Examined
from endolock.scripts.runs.experiment_fields import CONVERSIONS, converted, described
from endolock.scripts.runs.progress import progress
from endolock.scripts.runs.resolved import Resolved
from endolock.scripts.runs.run_record import RunRecord
from endolock.scripts.runs.stopping import closing
from endolock.scripts.runs.target_path import hindsight
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.scenario import Scenario
from endolock.vision.observation import Eyes
from endolock.vision.track_eyes import Selection

OPTIONS = {
    "camera.latency_s": "--latency-s",
    "duration_s": "--duration-s",
    "scored_from_s": "--scored-from-s",
}
"""Options for values of the scenario, by dotted key."""
RUNS = Path("runs")
"""Default parent of run folders."""


class Interrupted(KeyboardInterrupt):
    """A Ctrl-C or a kill ended a run between two ticks; handles hold, its folder is complete.

    Args:
        record: record of the run up to the interruption.
        message: when it was interrupted; made from the record if empty.
    """

    def __init__(self, record: RunRecord, message: str = "") -> None:
        super().__init__(message or f"after {record.duration_s:.1f} s")
        self.record = record

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.record, str(self))


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """One run of one controller on one scenario, from names or from objects.

    Example:
        >>> Experiment(scenario="rest", vision="truth", duration_s=1.0).resolve().scenario.name
        'rest'
    """

    scenario: str | Path | Scenario
    """Name, TOML file, or a loaded scenario."""
    controller: str | Controller | Callable[[Calibration], Controller] = "pi"
    """Name, .py file, an object with `reset` and `update`, or a class or function that makes one
    from the calibration."""
    rig: str | Rig = "twin"
    """Name of a rig, see `rigs.RIGS`, or serial:PORT; or a rig object made with the same scenario,
    which is not closed."""
    bench: Path | None = None
    """With serial: TOML file of the bench; bench.toml in the current folder if None."""
    vision: str | Eyes = "markers"
    """markers, track or truth; or an eyes object, which turns frames into observations."""
    select: Selection | None = None
    """With track: left, top, width and height of the region to follow in the first picture [px];
    the board's target if None."""
    instrument: str | Path | Instrument = "pretensioned"
    """Name, TOML file, or an instrument."""
    latency_s: float | None = None
    """Exposure to delivery of a frame [s]; the scenario's if None."""
    duration_s: float | None = None
    """Duration of the run [s]; the scenario's if None."""
    scored_from_s: float | None = None
    """Time from which the run is scored [s]; the scenario's if None."""
    vary: tuple[str, ...] = ()
    """Changes as for `overrides.read`, all of them applied."""
    force: bool = False
    """Run a controller even if its gains make the loop unstable."""
    seed: int = 0
    """Seed of all random numbers; the same seed gives the same tables."""
    out: Path | None = None
    """Run folder, new or empty; one below runs/ named by time if None."""

    def __post_init__(self) -> None:
        if isinstance(self.controller, Path):
            object.__setattr__(self, "controller", str(self.controller))
        for name in CONVERSIONS:
            object.__setattr__(self, name, converted(name, getattr(self, name)))
        if isinstance(self.rig, type) or not (
            isinstance(self.rig, str) or hasattr(self.rig, "camera")
        ):
            raise ConfigError(f"{self.rig!r} is not a rig", "give a name or an object")

    @property
    def controller_name(self) -> str:
        """Name of the controller in records and folders."""
        if isinstance(self.controller, str):
            return Path(self.controller).stem
        kind = type(self.controller).__name__
        return str(getattr(self.controller, "__name__", kind)).strip("<>")

    def resolve(self) -> Resolved:
        """Check everything and load all names and files; make no rig and write nothing.

        Raises:
            ConfigError: it cannot be run.
        """
        if isinstance(self.controller, str):
            registry.check(self.controller)
        bench, changes = None, self.changes
        if isinstance(self.rig, str):
            if not isinstance(self.vision, str):
                raise ConfigError(
                    "an eyes object needs the rig it was made for",
                    "give that rig too, or name the eyes",
                )
            rigs.check(self.rig, self.vision)
            bench = rigs.bench_of(self.rig, self.bench)
        chosen = self.instrument != "pretensioned"
        if bench and (chosen or any(entry.startswith("instrument.") for entry in self.vary)):
            raise ConfigError(
                "the instrument on a bench cannot be set",
                f"leave --instrument and instrument.NAME out with --rig {self.rig}",
            )
        # The bench's camera determines its latency, not the scenario.
        latency_s = bench.camera.latency_s if bench else getattr(self.rig, "latency_s", None)
        if latency_s is not None:
            changes.setdefault("camera.latency_s", latency_s)
        task = overrides.apply(self.scenario, self.instrument, self.vary, changes)
        scenario = task.scenario
        examined = Examined()
        if not isinstance(self.rig, str):
            if self.bench:
                raise ConfigError("a bench file goes with rig serial:PORT", "leave bench out")
            experiment_checks.check_rig(self.rig, task, self.seed)
        elif isinstance(self.vision, str):
            examined = experiment_checks.examine(
                self.rig, self.vision, self.vary, self._given(bench), task
            )
        known = self._known(scenario, task.instrument)
        settings = self._settings(task.law, {name: value for name, (value, _) in known.items()})
        if task.law and not self.force:
            theory.check_stable(self.controller_name, settings, scenario)
        return Resolved(
            scenario=scenario,
            instrument=task.instrument,
            numerics=task.numerics,
            settings=settings,
            known={name: source for name, (_, source) in known.items()},
            changes=task.changes,
            bench=bench,
            examined=examined,
        )

    def run(self, *, label: str = "", show_progress: bool = False) -> RunRecord:
        """Run, score, and complete the run folder.

        Args:
            label: text before the progress bar.
            show_progress: whether to show a progress bar.

        Raises:
            ConfigError: it cannot be run, and nothing was written; or its controller failed, or the
                simulation, and the folder holds everything up to there.
            HardwareError: the handles stopped; the folder holds everything up to the fault.
            Interrupted: a Ctrl-C or a kill ended it early.
        """
        # A law may change the working folder; afterwards it is the user's again.
        law = isinstance(self.controller, str) and self.controller.endswith(user_law.SUFFIX)
        with chdir(os.curdir) if law else nullcontext():
            return self._run(label, show_progress)

    def _run(self, label: str, show_progress: bool) -> RunRecord:
        task = self.resolve()
        scenario = task.scenario
        rig, eyes, until_closed = self._stage(task)  # a Ctrl-C meanwhile takes effect at once
        with closing() as stop:
            with until_closed, ExitStack() as afterwards:
                stop.check()
                handles = rig.actuators
                stop.abandon = handles.close
                controller = self._make(rig, task.settings)
                name = f"{scenario.name}-{self.controller_name}"
                path = self.out or run_folder.new_path(RUNS, name)
                scorer = metrics.Scorer(
                    rig.camera.calibration, scenario.scored_from_s, scenario.camera.exposure_s
                )
                described = self._described() | task.examined.described()
                folder = run_folder.RunFolder(path, {"run": described, **rig.describe()})
                stop.abandon = partial(close_all, handles.hold, folder.close, handles.close)
                start = time.perf_counter()
                shown = f"{label} {name}".strip()
                with folder, progress(shown, scenario.duration_s, show_progress, stop) as update:
                    if rig.line:
                        rig.line.record(folder.path / run_folder.BUS_LOG)
                        if rig is self.rig:  # its line goes on without this run
                            afterwards.callback(rig.line.stop_recording)
                    result = loop.run(
                        rig,
                        eyes,
                        controller,
                        duration_s=scenario.duration_s,
                        recorder=loop.Recorders(folder, scorer),
                        keep=False,
                        progress=update,
                    )
                wall_s = time.perf_counter() - start
            simulated = rig.truth is not None
            record = self._record(task, scorer, simulated, result.interrupted, folder.path, wall_s)
            folder.finish(record.as_dict())
            if stop.asked or record.interrupted:
                raise Interrupted(record)
            return record

    def _record(
        self,
        task: Resolved,
        scorer: metrics.Scorer,
        simulated: bool,
        interrupted: bool,
        folder: Path,
        wall_s: float,
    ) -> RunRecord:
        """Complete the scores of a run to its record."""
        scenario, scores, ran_s = task.scenario, scorer.scores(), scorer.ran_s
        needed = constant = None
        # The path is known from the start of a scenario; a rig object may be further on.
        fresh = isinstance(self.rig, str) or (scorer.began_t or 0.0) <= loop.PERIOD_S
        if simulated and fresh and ran_s > scenario.scored_from_s:
            ran = scenario.model_copy(update={"duration_s": ran_s})
            needed, constant = hindsight(ran, task.instrument, self.seed)
        plain = self._described()
        return RunRecord(
            **{field.name: getattr(scores, field.name) for field in fields(scores)},
            scenario=scenario.name,
            controller=self.controller_name,
            variation=overrides.label(self.vary),
            rig=plain["rig"],
            instrument=plain["instrument"],
            vision=plain["vision"],
            seed=self.seed,
            duration_s=ran_s,
            scored_from_s=scenario.scored_from_s,
            wall_s=wall_s,
            real_time_factor=ran_s / wall_s,
            latency_s=scenario.camera.latency_s,
            timestep_error_deg=task.examined.timestep_error_deg,
            interrupted=interrupted,
            needed_tip_deg=needed,
            constant_px=constant,
            folder=folder,
        )

    @property
    def changes(self) -> dict[str, Any]:
        """Values of the scenario that its fields change, by dotted key."""
        options = {
            "camera.latency_s": self.latency_s,
            "duration_s": self.duration_s,
            "scored_from_s": self.scored_from_s,
        }
        return {key: value for key, value in options.items() if value is not None}

    def _given(self, bench: Bench | None) -> dict[str, str]:
        """What replaces the values of variations, by dotted key."""
        by_bench = {"camera.latency_s": "the bench file"} if bench else {}
        return by_bench | {key: OPTIONS[key] for key in self.changes}

    def _known(self, scenario: Scenario, instrument: Instrument) -> dict[str, tuple[Any, str]]:
        """Values that controllers may know from the task, by name, and what they follow from."""
        known: dict[str, tuple[Any, str]] = {}
        if scenario.period_s is not None:
            known["period_s"] = scenario.period_s, "scenario"
        if self.controller == "oracle":
            kind = self.rig if isinstance(self.rig, str) else "twin"
            plays = rigs.plays_behind(kind, instrument, scenario.shaft_bend_deg)
            known["plays"] = plays, "instrument"
        return known

    def _settings(self, law: dict[str, Any], known: dict[str, Any]) -> Any:
        if isinstance(self.controller, str):
            return registry.configure(self.controller, law, known)
        if law:
            raise ConfigError(
                f"{self.controller_name} is an object", "set its parameters where it is made"
            )
        return None

    def _stage(self, task: Resolved) -> tuple[Rig, Eyes, AbstractContextManager[object]]:
        """Return rig and eyes, and what closes a rig that was made here."""
        if not isinstance(self.rig, str):
            eyes = self.vision
            if isinstance(eyes, str):
                eyes = rigs.eyes_of(self.rig, eyes, task.scenario, self.seed, self.select)
            return self.rig, eyes, nullcontext()
        assert isinstance(self.vision, str)  # see `resolve`
        made, eyes = rigs.make(
            self.rig,
            task.scenario,
            vision=self.vision,
            instrument=task.instrument,
            numerics=task.numerics,
            seed=self.seed,
            overview=True,
            select=self.select,
            bench=task.bench,
        )
        return made, eyes, made

    def _make(self, rig: Rig, settings: Any) -> Controller:
        calibration = rig.camera.calibration
        if isinstance(self.controller, str):
            return registry.make(self.controller, calibration, settings, rig.truth)
        return registry.adopt(self.controller, calibration)

    def _described(self) -> dict[str, Any]:
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return described(values, self.controller_name)
