"""The tables and the figure of docs/vision.md."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from endolock.scripts.figures import palette
from endolock.scripts.runs.latency_measurement import LatencyMeasurement
from endolock.scripts.runs.markdown_table import markdown_table
from endolock.scripts.studies import sequences, turn_accuracy, vision_accuracy
from endolock.twin.rig import TwinRig
from endolock.twin.world import scenario as scenarios
from endolock.vision.triple_check import LIMIT_PX

PARTS: dict[str, dict[str, Any]] = {
    "pinhole only": {},
    "fisheye 120 deg, octagon": {"camera.projection": "equidistant", "camera.mask": "octagon"},
    "fisheye 140 deg, octagon": {
        "camera.projection": "equidistant",
        "camera.diagonal_deg": 140.0,
        "camera.mask": "octagon",
    },
    "circle": {"camera.mask": "circle"},
    "vignette and gain": {"camera.vignette": 0.4, "camera.gain": 2.0},
    "motion blur of 3 pictures": {"camera.exposure_s": 0.04, "camera.sub_exposures": 3},
    "noise": {"camera.noise": 5.0},
    "JPEG 75": {"camera.jpeg_quality": 75},
    "tip light that falls off": {"light.falls_off": True},
    "back light": {"light.back": 1.0},
    "jitter, drops, repeats": {
        "camera.jitter_s": 0.01,
        "camera.drop_fraction": 0.05,
        "camera.repeat_fraction": 0.05,
    },
}
"""Optics that a scenario can switch on, as overrides."""


class VisionMeasurements:
    """All measurements, taken once for tables and figure."""

    def __init__(self) -> None:
        self.distances = {
            name: [vision_accuracy.markers(optics, d) for d in vision_accuracy.DISTANCES_M]
            for name, optics in vision_accuracy.OPTICS.items()
        }
        self.conditions = {
            name: vision_accuracy.markers(
                overrides,
                sequences.DISTANCE_M,
                tilt_deg=tilt,
                blur_px=blur,
                hidden=vision_accuracy.HIDDEN.get(name, 0.0),
            )
            for name, (overrides, tilt, blur) in vision_accuracy.CONDITIONS.items()
        }
        self.followed: dict[tuple[str, str, bool], dict[int, vision_accuracy.TrackerAccuracy]] = {}
        for board, path, hard in product(("rings", "tissue"), sequences.PATHS, (False, True)):
            sights = list(sequences.moving(path, vision_accuracy.FRAMES, hard=hard, board=board))
            self.followed[board, path, hard] = {
                half: vision_accuracy.follow(iter(sights), half) for half in vision_accuracy.WINDOWS
            }
        self.hidden = vision_accuracy.hide(sequences.OCCLUSIONS)
        self.right, self.wrong = vision_accuracy.triple(sequences.OCCLUSIONS)
        self.turns = turn_accuracy.measured()
        self.latencies = {
            (true, jitter): LatencyMeasurement(latency_s=true, jitter_s=jitter).run()
            for true, jitter in ((0.1, 0.0), (0.33, 0.0), (0.4, 0.015), (0.8, 0.0))
        }

    def tables(self) -> dict[str, str]:
        """Return each table as Markdown, by the name of its mark in docs/vision.md."""
        return {
            "distance": self._distance(),
            "condition": self._condition(),
            "tracker": self._tracker(),
            "hidden": self._hidden(),
            "turns": turn_accuracy.table(self.turns),
            "latency": self._latency(),
        }

    def _distance(self) -> str:
        head = ["distance"]
        for name in self.distances:
            head += [f"{name}: px rms", "px max", "depth % rms", "found"]
        rows = []
        for n, distance in enumerate(vision_accuracy.DISTANCES_M):
            row = [f"{1e3 * distance:.0f} mm"]
            for series in self.distances.values():
                row += _marked(series[n])
            rows.append(row)
        return markdown_table(head, rows)

    def _condition(self) -> str:
        head = ["at 12 cm", "px rms", "px max", "depth % rms", "found"]
        return markdown_table(head, [[name, *_marked(m)] for name, m in self.conditions.items()])

    def _tracker(self) -> str:
        head = [
            "target",
            "path",
            "pictures",
            *(f"{2 * half + 1} px" for half in vision_accuracy.WINDOWS),
        ]
        rows = []
        for (board, path, hard), by_window in self.followed.items():
            row = [board, path, "hard" if hard else "clean"]
            for result in by_window.values():
                lost = f" ({result.refused} refused)" if result.refused else ""
                row.append(f"{result.rms_px:.3f}{lost}")
            rows.append(row)
        return markdown_table(head, rows)

    def _hidden(self) -> str:
        h = self.hidden
        refused = float(np.mean(np.array(self.right) > LIMIT_PX))
        rows = [
            ["frames with more than 60 % of the window hidden", f"{h.hidden}"],
            ["of these accepted", f"{h.accepted_hidden}"],
            ["frames accepted in all", f"{h.accepted}"],
            [f"of these off by more than {vision_accuracy.WRONG_PX:.0f} px", f"{h.wrong}"],
            ["largest error of an accepted frame", f"{h.worst_px:.2f} px"],
            ["most frames with the target in sight before it was accepted again", f"{h.latest}"],
            [
                f"wrong frames that the triple check alone, at {LIMIT_PX:g} px, lets pass",
                f"{100 * np.mean(np.array(self.wrong) <= LIMIT_PX):.0f} %",
            ],
            ["right frames that it refuses", f"{100 * refused:.1f} %"],
        ]
        return markdown_table(["over the occlusion set", ""], rows)

    def _latency(self) -> str:
        rows = []
        for (true, jitter), found in self.latencies.items():
            low, high = found.ci95_s
            cells = [f"{true:.2f} s", f"+-{1e3 * jitter:.0f} ms", f"{found.latency_s:.4f} s"]
            cells += [f"{low:.4f} to {high:.4f} s", f"{1e3 * (found.latency_s - true):+.1f} ms"]
            rows.append([*cells, f"{1e3 * found.jitter_s:.1f} ms"])
        head = [
            "latency",
            "jitter",
            "measured",
            "95 % interval",
            "error",
            "jitter (std)",
        ]
        return markdown_table(head, rows)

    def draw(self, path: Path) -> None:
        """Draw the errors over distance and over the tracker's window, and the ROC."""
        figure = Figure(figsize=(11, 7.2), layout="constrained", dpi=110)
        (pixel, depth), (windows, roc) = figure.subplots(2, 2)
        millimetres = 1e3 * np.array(vision_accuracy.DISTANCES_M)
        for (name, series), colour in zip(self.distances.items(), palette.SERIES[:3], strict=True):
            style = {"color": colour, "label": name, "marker": "o", "markersize": 3.5}
            pixel.loglog(millimetres, [m.pixel_rms for m in series], **style)
            depth.loglog(millimetres, [100 * m.depth_rms for m in series], **style)
        pixel.axhline(0.1, color="0.6", lw=1, ls="--")
        pixel.set(title="target by markers", ylabel="rms error [px]", xlabel="distance [mm]")
        depth.plot([15, 40], [1, 1], color="0.6", lw=1, ls="--")
        depth.plot([60, 160], [0.1, 0.1], color="0.6", lw=1, ls="--", label="required")
        depth.set(title="depth by markers", ylabel="rms error [%]", xlabel="distance [mm]")
        pixel.legend(fontsize=8, frameon=False)
        depth.legend(fontsize=8, frameon=False)
        for axes in (pixel, depth):
            axes.set_xticks(millimetres, [f"{m:.0f}" for m in millimetres], minor=False)
            axes.minorticks_off()
        for n, ((board, hard), colour) in enumerate(
            zip(
                product(("rings", "tissue"), (False, True)),
                (palette.LIGHT_BLUE, palette.BLUE, palette.LIGHT_ORANGE, palette.ORANGE),
                strict=True,
            )
        ):
            rms = [
                np.mean([self.followed[board, p, hard][half].rms_px for p in sequences.PATHS])
                for half in vision_accuracy.WINDOWS
            ]
            label = f"{board}, {'hard' if hard else 'clean'}"
            position = np.arange(len(rms)) + 0.2 * (n - 1.5)
            windows.bar(position, rms, 0.2, color=colour, label=label)
        windows.axhline(0.15, color="0.6", lw=1, ls="--")
        windows.axhline(0.05, color="0.6", lw=1, ls=":")
        names = [f"{2 * half + 1}" for half in vision_accuracy.WINDOWS]
        windows.set_xticks(range(len(names)), names)
        windows.set(title="tracker", ylabel="rms error [px]", xlabel="side of the window [px]")
        windows.legend(fontsize=8, frameon=False, ncols=2)
        limits = np.concatenate([[0.0], np.geomspace(0.01, 30, 200), [np.inf]])
        false, true = (
            [np.mean(np.array(values) <= limit) for limit in limits]
            for values in (self.wrong, self.right)
        )
        roc.plot(false, true, color=palette.BLUE)
        at = np.mean(np.array(self.wrong) <= LIMIT_PX), np.mean(np.array(self.right) <= LIMIT_PX)
        roc.plot(*at, "o", color=palette.ORANGE)
        roc.annotate(
            f"limit {LIMIT_PX:g} px", at, (-8, -16), textcoords="offset points", ha="right"
        )
        roc.plot([0, 1], [0, 1], color="0.8", lw=1)
        title = "triple check alone, on a follower from frame to frame"
        roc.set(title=title, xlabel="wrong frames it lets pass", ylabel="right frames it lets pass")
        for axes in (pixel, depth, windows, roc):
            axes.spines[["top", "right"]].set_visible(False)
        figure.savefig(path)


def costs() -> str:
    """Return the wall time of each part of the optics on this machine, as Markdown.

    `./run python -m endolock.scripts.studies.vision_docs` prints it.
    """
    taken: dict[str, list[float]] = {name: [] for name in PARTS}
    for _ in range(3):
        for name, overrides in PARTS.items():
            with TwinRig(scenarios.load("circle", overrides)) as rig:
                rig.clock.sleep_until(0.2)
                start = time.perf_counter()
                rig.clock.sleep_until(1.2)
                rig.close()  # waits for the pictures in work
                taken[name].append(time.perf_counter() - start)
    base = min(taken["pinhole only"])
    rows = [[name, f"{1e3 * min(t) / 25:.1f}", f"{min(t) / base:.2f}"] for name, t in taken.items()]
    return markdown_table(["switched on", "ms a frame, physics included", "to the pinhole"], rows)


def _marked(m: vision_accuracy.MarkerAccuracy) -> list[str]:
    if not m.found:
        return ["-", "-", "-", "0 %"]
    return [
        f"{m.pixel_rms:.3f}",
        f"{m.pixel_max:.2f}",
        f"{100 * m.depth_rms:.3f}",
        f"{100 * m.found:.0f} %",
    ]


def write(folder: Path, between: Callable[[str, str, str], str]) -> None:
    """Regenerate the tables of docs/vision.md, and docs/vision.png.

    Args:
        folder: docs/.
        between: replaces the text between two marks.
    """
    measured = VisionMeasurements()
    page = folder / "vision.md"
    text = page.read_text(encoding="utf-8")
    for name, table in measured.tables().items():
        text = between(text, name, table)
    page.write_text(text, encoding="utf-8")
    measured.draw(folder / "vision.png")


if __name__ == "__main__":
    print(costs())
