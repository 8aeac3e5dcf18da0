"""Figure of `endolock hysteresis`: the loop, the lost motion, and the maps."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, pi
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import figure
from matplotlib.axes import Axes

from endolock.hw.api import Vector
from endolock.scripts.figures import palette

LOOP, DEADBAND = palette.BLUE, palette.DARK_GREY
POSITIVE, NEGATIVE = palette.ORANGE, palette.GREEN


def draw(record: Mapping[str, Any], path: Path) -> Path:
    """Draw a record of `endolock hysteresis`.

    Args:
        record: the record of the command; with "map" and "shaft_map" there is a second row.
        path: the PNG to write.
    """
    rows = 2 if "map" in record else 1
    picture = figure.Figure(figsize=(11, 4.6 * rows), layout="constrained")
    axes = picture.subplots(rows, 2, squeeze=False)
    picture.suptitle(
        f"{record['instrument']}, {record['axis']}: shaft bent by {record['shaft_deg']:g} deg, "
        f"other axis by {record['other_axis_deg']:.0f} deg"
    )
    _loop(axes[0, 0], record)
    _lost(axes[0, 1], record)
    if rows == 2:
        _map(axes[1, 0], record["map"])
        _shaft(axes[1, 1], record["shaft_map"])
    picture.savefig(path, dpi=120)
    return path


def _loop(axes: Axes, record: Mapping[str, Any]) -> None:
    handle, bend = np.degrees(record["loop"]).T
    axes.plot(handle, bend, color=LOOP, label="full loop")
    turn = int(handle.argmin())
    branches = (handle[:turn], bend[:turn]), (handle[turn:], bend[turn:])
    for at, share in record["width"].items():
        if share is None:
            continue
        ends = [float(_crossing(h, b, float(at))) for h, b in branches]
        axes.annotate(
            "", (max(ends), float(at)), (min(ends), float(at)), arrowprops={"arrowstyle": "<->"}
        )
        axes.text(max(ends) + 6, float(at), f"{180 * share:.0f} deg", va="center", fontsize=9)
    axes.set(xlabel="handle [deg]", ylabel="bend [deg]", title="slow full loop")
    axes.set(xticks=range(-180, 181, 60), yticks=range(-120, 121, 30))
    axes.margins(x=0.12)
    axes.grid(alpha=0.3)


def _crossing(handle: Vector, bend: Vector, at: float) -> float:
    order = np.argsort(bend)
    return float(np.interp(at, bend[order], handle[order]))


def _lost(axes: Axes, record: Mapping[str, Any]) -> None:
    _line(axes, record["width"], "full loop, at this bend", color=LOOP, marker="o")
    for side, colour in (("positive", POSITIVE), ("negative", NEGATIVE)):
        turns = record["strokes"][side]
        _line(
            axes,
            turns["back"],
            f"{side} stroke to this bend: at its turn",
            color=colour,
            marker="s",
        )
        _line(
            axes,
            turns["out"],
            f"{side} stroke to this bend: at the turn at zero",
            color=colour,
            marker="^",
            linestyle="--",
        )
    axes.set(xlabel="bend [deg]", ylabel="lost handle motion [of 180 deg]", ylim=(0, None))
    axes.set_title(
        f"deadband {degrees(record['deadband_rad']):.1f} deg, "
        f"drift {record['drift_deg_per_min']:.2f} deg/min"
    )
    axes.set_xticks([0, 30, 60, 90])
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)


def _line(axes: Axes, shares: Mapping[str, float | None], label: str, **style: Any) -> None:
    found = [(float(bend), share) for bend, share in shares.items() if share is not None]
    if found:
        axes.plot(*zip(*found, strict=True), label=label, **style)


def _map(axes: Axes, measured: Mapping[str, Any]) -> None:
    shares = np.array(measured["width"], float)
    image = axes.pcolormesh(
        measured["own_deg"], measured["other_deg"], shares, cmap="viridis", shading="nearest"
    )
    for other, row in zip(measured["other_deg"], shares, strict=True):
        for own, share in zip(measured["own_deg"], row, strict=True):
            if np.isfinite(share):
                dark = share < np.nanmin(shares) + 0.6 * np.ptp(shares[np.isfinite(shares)])
                axes.text(
                    own,
                    other,
                    f"{share:.2f}",
                    ha="center",
                    va="center",
                    fontsize=7,
                    color="white" if dark else "black",
                )
    axes.figure.colorbar(image, ax=axes, label="width [of 180 deg]")
    axes.set(xlabel="own bend [deg]", ylabel="other axis [deg]", title="width of the full loop")
    axes.set(xticks=measured["own_deg"], yticks=measured["other_deg"])


def _shaft(axes: Axes, measured: Mapping[str, Any]) -> None:
    shafts = [str(shaft) for shaft in measured["shaft_deg"]]
    deadbands = [None if value is None else value / pi for value in measured["deadband_rad"]]
    widths = dict(zip(shafts, measured["width_at_30"], strict=True))
    _line(axes, widths, "width at 30 deg of bend", color=LOOP, marker="o")
    beside = dict(zip(shafts, deadbands, strict=True))
    _line(axes, beside, "deadband", color=DEADBAND, marker="s", clip_on=False)
    axes.set(xlabel="shaft [deg]", ylabel="handle motion [of 180 deg]", ylim=(0, None))
    axes.set_title("bend of the shaft")
    axes.set_xticks(range(0, 361, 90))
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
