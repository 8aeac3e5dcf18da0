"""Figures 6.4 to 6.8 of the thesis from our runs, with the excerpt's bounds as bands."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from endolock.scripts.figures import palette
from endolock.scripts.thesis.chapter_runs import Trace

NAMES = {"pi": "PI", "pi_hc": "PI + compensation", "ik": "inverse kinematics"}
COLOURS = {"pi": palette.BLUE, "pi_hc": palette.ORANGE, "ik": palette.GREEN}
TITLES = {"a": "(a) our simulation", "b": "(b) our twin"}


def draw(runs: Mapping[str, Mapping[str, Trace]], folder: Path) -> list[Path]:
    """Draw all figures, and write the data of each to a CSV file beside it.

    Args:
        runs: traces by column and name.
        folder: where to write.

    Returns:
        The paths of the pictures.
    """
    bands = {"6.4": {"a": (180, 200), "b": (200, 250)}, "6.6": {"a": (0, 150), "b": (0, 180)}}
    pair = {"6.4": ("straight", ("pi", "pi_hc")), "6.6": ("straight", ("ik", "pi_hc"))}
    made = []
    for number, (scenario, laws) in {**pair, "6.7": ("circle", ("ik", "pi_hc", "pi"))}.items():
        figure, panels = _panels(1, 2)
        top = 1.08 * max(
            one[f"{scenario}-{law}"].total.max() for one in runs.values() for law in laws
        )
        for panel, (column, traces) in zip(panels[0], runs.items(), strict=True):
            low, high = bands.get(number, {}).get(column, (0, 180))
            text = "excerpt: peak in here" if low else "excerpt: all below"
            panel.axhspan(low, high, color=palette.BAND, lw=0, label=text)
            for law in laws:
                one = traces[f"{scenario}-{law}"]
                panel.plot(one.t, one.total, color=COLOURS[law], lw=1.2, label=NAMES[law])
            _finish(
                panel, TITLES[column], "distance from the centre [px]", (0, max(top, 1.1 * high))
            )
        made.append(_save(figure, panels, folder / f"figure_{number}.png"))
        _csv(folder / f"figure_{number}.csv", runs, [(scenario, law) for law in laws])

    figure, panels = _panels(1, 1)
    one, panel = runs["b"]["straight-pi_hc"], panels[0, 0]
    panel.plot(one.t, one.error[:, 0], color=COLOURS["pi"], lw=1.2, label="x offset of the target")
    _finish(panel, TITLES["b"] + ": PI + compensation", "offset [px]", (-210, 210))
    other = panel.twinx()
    other.plot(one.handle_t, one.handle[:, 1], color=COLOURS["pi_hc"], lw=1.2, label="handle angle")
    other.set_ylabel("handle angle [deg]")
    other.spines["right"].set_visible(True)
    made.append(_save(figure, panels, folder / "figure_6.5.png", also=[other]))
    _csv(folder / "figure_6.5.csv", {"b": runs["b"]}, [("straight", "pi_hc")])

    figure, panels = _panels(2, 2)
    shown = [one[f"circle-{law}"].error for one in runs.values() for law in ("pi", "pi_hc")]
    reach = 1.08 * max(float(np.abs(error).max()) for error in shown)
    for row, (axis, name) in enumerate((("left_right", "x"), ("up_down", "y"))):
        for panel, (column, traces) in zip(panels[row], runs.items(), strict=True):
            for law in ("pi", "pi_hc"):
                one = traces[f"circle-{law}"]
                panel.plot(one.t, one.error[:, row], color=COLOURS[law], lw=1.2, label=NAMES[law])
            angle = one.compensation[:, 1 - row]
            label = "compensation [deg]"
            panel.plot(one.handle_t, angle, color=palette.GREY, lw=1, label=label)
            title = f"{TITLES[column]}: {name} direction ({axis})"
            _finish(panel, title, "offset [px]", (-reach, reach))
    made.append(_save(figure, panels, folder / "figure_6.8.png"))
    _csv(folder / "figure_6.8.csv", runs, [("circle", law) for law in ("pi", "pi_hc")])
    return made


def _panels(rows: int, columns: int) -> tuple[Any, Any]:
    from matplotlib.figure import Figure  # half a second to load

    figure = Figure(figsize=(5.6 * columns, 3.3 * rows + 0.3), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def _finish(panel: Any, title: str, label: str, limits: tuple[float, float]) -> None:
    panel.set_title(title, loc="left", fontsize=10)
    panel.set_ylabel(label)
    panel.set_ylim(limits)
    panel.set_xlabel("time [s]")
    panel.margins(x=0)
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(alpha=0.25)


def _save(figure: Any, panels: Any, path: Path, also: list[Any] | None = None) -> Path:
    drawn = [panels[0, 0], *(also or [])]
    handles: list[Any] = []
    names: list[str] = []
    for panel in drawn:
        lines, labels = panel.get_legend_handles_labels()
        handles, names = handles + lines, names + labels
    figure.legend(handles, names, loc="outside lower center", ncols=len(names), frameon=False)
    figure.savefig(path, dpi=120)
    return path


def _csv(
    path: Path, runs: Mapping[str, Mapping[str, Trace]], chosen: list[tuple[str, str]]
) -> None:
    """Write time, offsets, handle angles and compensation of the runs of a figure, per frame."""
    head = "column,law,t_s,x_px,y_px,up_down_deg,left_right_deg,"
    lines = [head + "compensation_up_down_deg,compensation_left_right_deg"]
    for column, traces in runs.items():
        for scenario, law in chosen:
            one = traces[f"{scenario}-{law}"]
            sides = [
                np.interp(one.t, one.handle_t, values)
                for values in (*one.handle.T, *one.compensation.T)
            ]
            for row in np.column_stack([one.t, one.error, *sides]).tolist():
                lines.append(f"{column},{law}," + ",".join(f"{value:.4g}" for value in row))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
