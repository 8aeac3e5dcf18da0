"""A strip of pictures of the tip camera from one run, or from several to compare, as a PNG."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from endolock.hw.api import ConfigError, Image
from endolock.scripts.figures.palette import RGB_BLUE, RGB_GREEN, RGB_INK, RGB_PAPER
from endolock.scripts.runs import log_tables, run_folder

PICTURES = 6
WIDTH_PX = 320


def pictures(folder: Path) -> list[dict[str, Any]]:
    """Read the frames of a run that carry a picture."""
    return [row for row in run_folder.read(folder, "frames").to_pylist() if row["tip_jpeg"]]


def write(runs: Mapping[str, Path], path: Path, since_s: float = 0.0) -> Path:
    """Draw pictures side by side, evenly spaced, with centre, target, time and error.

    Args:
        runs: run folders by what to call them; each gets a row.
        path: the PNG to write.
        since_s: time of the first picture [s], at least.

    Raises:
        ConfigError: a run has no pictures from that time on.
    """
    rows = [_row(name, folder, since_s) for name, folder in runs.items()]
    cv2.imwrite(str(path), cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR))
    return path


def _row(name: str, folder: Path, since_s: float) -> Image:
    """Draw the pictures of one run."""
    rows = [row for row in pictures(folder) if row["t_available"] >= since_s]
    if not rows:
        raise ConfigError(f"the run in {folder} has no pictures", "run it with vision markers")
    configuration = run_folder.configuration(folder)
    centre = tuple(configuration["calibration"]["centre_px"])
    chosen = [rows[i] for i in np.linspace(0, len(rows) - 1, PICTURES).round().astype(int)]
    drawn = [_draw(row, centre, name if n == 0 else "") for n, row in enumerate(chosen)]
    gap = np.full((drawn[0].shape[0], 4, 3), RGB_PAPER, np.uint8)
    parts: list[Image] = []
    for picture in drawn:
        parts += [picture, gap]
    return np.hstack(parts[:-1])


def _draw(row: dict[str, Any], centre: tuple[float, float], name: str) -> Image:
    picture = log_tables.decode(row["tip_jpeg"])
    scale = WIDTH_PX / picture.shape[1]
    height = round(picture.shape[0] * scale)
    small = cv2.resize(picture, (WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    u, v = (round((c + 0.5) * scale) for c in centre)
    cv2.line(small, (u - 9, v), (u + 9, v), RGB_GREEN, 1, cv2.LINE_AA)
    cv2.line(small, (u, v - 9), (u, v + 9), RGB_GREEN, 1, cv2.LINE_AA)
    text = f"{row['t_available']:.1f} s   {row['status']}"
    if row["status"] == "tracking":
        spot = tuple(round((c + 0.5) * scale) for c in row["target_px"])
        cv2.line(small, (u, v), spot, RGB_BLUE, 1, cv2.LINE_AA)
        cv2.circle(small, spot, 12, RGB_BLUE, 2, cv2.LINE_AA)
        error_px = np.hypot(*np.subtract(row["target_px"], centre))
        text = f"{row['t_available']:.1f} s   {error_px:.0f} px"
    text = f"{name}   {text}" if name else text
    label = np.full((24, WIDTH_PX, 3), RGB_PAPER, np.uint8)
    cv2.putText(label, text, (8, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.5, RGB_INK, 1, cv2.LINE_AA)
    return np.vstack([small, label])
