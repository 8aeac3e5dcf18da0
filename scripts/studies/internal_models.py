"""Accuracy of models of the transmission while the lock runs: plays against the capstan model.

The lock is run, its handle angles are fed to each model, and the model's bend is compared with the
true bend over the second half. A constant offset does no harm to a lock that uses one model
forwards and backwards, so it is removed. Errors are given in pixels of the picture.

`./run python -m endolock.scripts.studies.internal_models` prints the table of docs/predictive.md; a
minute.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from math import pi
from pathlib import Path

import numpy as np

from endolock.control.identification import fits
from endolock.control.identification.handle_log import HandleLog
from endolock.control.predictive.handle_history import RADII
from endolock.control.transmission.both_axes import CableTransmission
from endolock.control.transmission.kinematics import SectionGeometry
from endolock.control.transmission.linear_process import image_gain
from endolock.control.transmission.plays import Plays, fit, play
from endolock.control.transmission.quasi_static import Cable, Geometry
from endolock.hw.api import AXES, Vector
from endolock.scripts import cli
from endolock.scripts.runs import run_folder
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.markdown_table import markdown_table
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.instrument_cable import cable_of

SCENARIOS = ("straight", "circle", "triangle", "random")
LAW = "predictive_bank"
DURATION_S = 100.0
SHAFT_RAD = pi  # as in these scenarios
RESTS_RAD = 0.05
"""An axis that moves less counts as at rest and is not fitted [rad]: 3 deg."""


def table() -> str:
    """Run the lock and the models, and return the table as Markdown."""
    rows: dict[str, list[str]] = {}
    for name in SCENARIOS:
        log, own, pixels = _log(name)
        later = log.t >= DURATION_S / 2
        for model, predict in _models(log, own).items():
            off = (predict() - log.bend)[later]
            rms = float(np.sqrt(off.var(axis=0).sum()))
            rows.setdefault(model, []).append(f"{pixels * rms:.1f}")
    return markdown_table(["model, rms px", *SCENARIOS], [[m, *cells] for m, cells in rows.items()])


def _models(log: HandleLog, own: Vector) -> dict[str, Callable[[], Vector]]:
    """Return functions that predict the bends of a log, m x 2 [rad], by name."""
    known = cable_of(Instrument(), SHAFT_RAD)
    return {
        "no hysteresis": lambda: _fitted_plays(log, (0.0,)),
        "best single play": lambda: min(
            (_fitted_plays(log, (r,)) for r in RADII[:5]),  # wider plays hardly move
            key=lambda bend: float((bend - log.bend).var(axis=0).sum()),
        ),
        "plays, best weights for the whole run": lambda: _fitted_plays(log, tuple(RADII.tolist())),
        "capstan, parameters known": lambda: _capstan(log, known),
        "capstan, fitted to the first half": lambda: _capstan(log, _fitted_cable(log)),
        "model in use by the lock at the time": lambda: own,
    }


def _log(name: str) -> tuple[HandleLog, Vector, float]:
    """Run the lock; return its log, the bend of the lock's own model, and pixels per bend angle."""
    with tempfile.TemporaryDirectory() as temporary:
        experiment = Experiment(
            scenario=name,
            controller=LAW,
            vision="truth",
            vary=("camera.truth_noise_px=0.3",),
            duration_s=DURATION_S,
            out=Path(temporary) / "run",
        )
        folder = experiment.run().folder
        ticks = run_folder.read(folder, "ticks")
        set_up = run_folder.configuration(folder)
    handle, bend = (np.array(ticks[key].to_pylist()) for key in ("position_rad", "bend_rad"))
    signals = [dict(row or ()) for row in ticks["signals"].to_pylist()]
    own = np.array([[row.get(f"bend_{axis}_rad", 0.0) for axis in AXES] for row in signals])
    own = np.concatenate([own[1:], own[-1:]])  # signals are logged with the command, a tick later
    distance_m = set_up["scenario"]["board"]["distance_m"]
    pixels = set_up["calibration"]["focal_px"] * image_gain(SectionGeometry(), distance_m, 1.0)
    return HandleLog(np.array(ticks["t"]), handle, bend), own, pixels


def _fitted_plays(log: HandleLog, radii: tuple[float, ...]) -> Vector:
    columns = []
    for handle, bend in zip(log.handle.T, log.bend.T, strict=True):
        if np.ptp(bend) < RESTS_RAD:
            columns.append(np.zeros(len(handle)))
            continue
        plays, _ = fit(handle, bend, radii)
        columns.append(_forward(plays, handle))
    return np.column_stack(columns)


def _forward(plays: Plays, handle: Vector) -> Vector:
    return sum(
        (w * play(handle, r) for r, w in zip(plays.radii, plays.weights, strict=True)),
        np.zeros(len(handle)),
    )


def _fitted_cable(log: HandleLog) -> Cable:
    """Fit the axis that moves more, over the first half; the other axis uses the same cable."""
    half = len(log.t) // 2
    first = HandleLog(log.t[:half], log.handle[:half], log.bend[:half])
    return fits.fit(first, Geometry()).cable


def _capstan(log: HandleLog, cable: Cable) -> Vector:
    axes = CableTransmission(cable=cable, geometry=Geometry()).at_rest()
    return np.array([axes.follow((one, other)) for one, other in log.handle.tolist()])


def main(_args: list[str]) -> int:
    """Print the table."""
    print(table())
    return 0


if __name__ == "__main__":
    sys.exit(cli.guarded(main, sys.argv[1:]))
