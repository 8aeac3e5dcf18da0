"""Figure of `endolock compare`: the error of every run over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow.compute as pc

from endolock.scripts.figures.palette import SERIES
from endolock.scripts.runs import run_folder
from endolock.scripts.runs.run_record import RunRecord
from endolock.vision.observation import Status


def draw(records: Sequence[RunRecord], path: Path) -> Path:
    """Draw the true error of every run over time, one panel a scenario, one colour a controller.

    Args:
        records: of the runs.
        path: the PNG to write.
    """
    from matplotlib.figure import Figure  # half a second to load

    names = list(dict.fromkeys(record.scenario for record in records))
    controllers = list(dict.fromkeys(record.controller for record in records))
    figure = Figure(figsize=(9, 0.6 + 2.6 * len(names)), layout="constrained")
    panels = figure.subplots(len(names), 1, squeeze=False)[:, 0]
    for record in records:
        panel = panels[names.index(record.scenario)]
        t, error = error_over_time(record.folder)
        controller = record.controller
        colour = SERIES[controllers.index(controller) % len(SERIES)]
        first = controller not in panel.get_legend_handles_labels()[1]
        panel.plot(t, error, color=colour, lw=1.2, label=controller if first else None)
    for panel, name in zip(panels, names, strict=True):
        panel.set_title(name, loc="left", fontsize=10)
        panel.set_ylabel("error [px]")
        panel.set_ylim(bottom=0)
        panel.margins(x=0)
        panel.grid(alpha=0.3)
        position = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.0}
        panel.legend(ncols=len(controllers), frameon=False, **position)
    panels[-1].set_xlabel("time [s]")
    figure.savefig(path, dpi=130)
    return path


def error_over_time(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and errors [px] of a logged run: the true ones; on a bench what vision saw."""
    rows = run_folder.read(folder, "ticks")
    centre = run_folder.configuration(folder)["calibration"]["centre_px"]
    t = rows["t"]
    if rows["target_px"].null_count == rows.num_rows:
        rows = run_folder.read(folder, "frames")
        rows = rows.filter(pc.equal(rows["status"], Status.TRACKING))
        t = rows["t_available"]
    pixels = np.array(rows["target_px"].to_pylist(), float).reshape(-1, 2)
    return np.array(t), np.hypot(*(pixels - centre).T)
