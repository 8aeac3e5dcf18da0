"""Accuracy of the camera's rotation from the background, on rendered pictures against the truth.

`./run python -m endolock.scripts.studies.turn_accuracy` prints the table of docs/vision.md.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from math import degrees, inf, nan, pi, sin
from typing import Any, NamedTuple

import numpy as np

from endolock.control import loop
from endolock.hw import rotation
from endolock.hw.api import Command, Frame, State, Vector
from endolock.scripts.runs.markdown_table import markdown_table
from endolock.twin.rig import TwinRig
from endolock.twin.world import scenario as scenarios
from endolock.vision.marker_eyes import MarkerEyes
from endolock.vision.observation import Observation, Status

DURATION_S = 12.0
SWINGS = ((0.45, 0.11), (0.15, 0.43), (0.07, 1.3))
"""Amplitude [rad] and frequency [Hz] of the sines that the handles follow."""
FEWEST = 10
"""Fewest rotations that are counted [1]."""
BANDS = {"below 0.1 deg a frame": (1e-5, 0.1), "0.1 to 0.5": (0.1, 0.5), "above 0.5": (0.5, inf)}
"""Rotations that are counted together [deg]."""
CONDITIONS: dict[str, tuple[str, Mapping[str, Any]]] = {
    "straight, 120 mm": ("straight", {}),
    "circle, 120 mm": ("circle", {}),
    "at rest, 60 mm": ("rest", {"board.distance_m": 0.06}),
    "endoscope, 120 mm": ("endoscope", {}),
    "close, 15 mm": ("close", {}),
}
"""Scenario and overrides, by name."""


class TurnAccuracy(NamedTuple):
    """Errors of the rotations from frame to frame."""

    offered: float
    """Share of the usable frames that have one [1]."""
    scale: float
    """Measured over true, by least squares [1]."""
    bands: tuple[tuple[float, float], ...]
    """For each band, the rms error [deg], and the mean square of the error in standard
    deviations [1]."""
    drift_deg: float
    """Sum of all errors [deg]."""
    extra_ms: float
    """Median time of one rotation [ms]."""


class _Swings:
    """Moves the handles without looking."""

    def reset(self, state: State) -> None:
        """Need nothing."""

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Follow sines; the axes are out of step."""
        angles = [sum(a * sin(2 * pi * f * x) for a, f in SWINGS) for x in (0.83 * t, t)]
        return Command(position=angles)


def measure(name: str, overrides: Mapping[str, Any], seed: int = 5) -> TurnAccuracy:
    """Compare the rotations of marker eyes with the truth while the handles swing.

    Args:
        name: the scenario.
        overrides: what differs in it.
        seed: seed of the rig.
    """
    tips: dict[float, rotation.Quaternion] = {}
    true, off, spread, taken = [], [], [], []
    usable = 0
    with TwinRig(scenarios.load(name, overrides), seed=seed) as rig:
        eyes = MarkerEyes(rig.camera.calibration, rig.board)

        def look(frame: Frame) -> Observation:
            nonlocal usable
            tips[frame.t_capture] = rig.truth.at_exposure(frame.seq).plant.tip.quaternion
            _, fit = eyes.look(frame)
            start = time.perf_counter()
            turn = eyes.turning(frame, None if isinstance(fit, str) else fit.pose)
            taken.append(time.perf_counter() - start)
            usable += not frame.repeated and len(tips) > 1
            if turn is not None:
                w, x, y, z = tips[turn.since_s]
                exact = rotation.product((w, -x, -y, -z), tips[frame.t_capture])
                true.append(rotation.to_vector(exact))
                off.append(np.subtract(turn.vector, true[-1]))
                spread.append(turn.covariance)
            return Observation(t_capture=frame.t_capture, seq=frame.seq, status=Status.SEARCHING)

        loop.run(rig, look, _Swings(), duration_s=DURATION_S)
    if len(true) < FEWEST:
        return TurnAccuracy(0.0, nan, (), nan, 1e3 * float(np.median(taken)))
    return _summary(usable, np.array(true), np.array(off), np.array(spread), taken)


def _summary(
    usable: int, true: Vector, off: Vector, spread: Vector, taken: list[float]
) -> TurnAccuracy:
    size = np.degrees(np.linalg.norm(true, axis=1))
    square = np.einsum("ni,nij,nj->n", off, np.linalg.inv(spread), off) / 3
    bands = []
    for low, high in BANDS.values():
        some = (size >= low) & (size < high)
        rms = degrees(float(np.sqrt((off[some] ** 2).sum(axis=1).mean()))) if some.any() else nan
        bands.append((rms, float(square[some].mean()) if some.any() else nan))
    return TurnAccuracy(
        offered=len(true) / usable,
        scale=1 + float((off * true).sum() / (true**2).sum()),
        bands=tuple(bands),
        drift_deg=degrees(float(np.linalg.norm(off.sum(axis=0)))),
        extra_ms=1e3 * float(np.median(taken)),
    )


def table(measured: Mapping[str, TurnAccuracy]) -> str:
    """Return measured accuracies as Markdown, one row each; without times, which vary."""
    head = ["scenario, distance of the board", "frames with one", "scale"]
    for band in BANDS:
        head += [f"{band}: rms deg", "in std"]
    rows = []
    for name, m in measured.items():
        parts = [p for rms, square in m.bands for p in (f"{rms:.4f}", f"{np.sqrt(square):.2f}")]
        scale = f"{m.scale:.3f}" if m.bands else "-"
        rows.append(
            [name, f"{100 * m.offered:.0f} %", scale, *(parts or ["-"] * 2 * len(BANDS))]
            + [f"{m.drift_deg:.2f}" if m.bands else "-"]
        )
    return markdown_table([*head, f"drift in {DURATION_S:.0f} s, deg"], rows)


def measured() -> dict[str, TurnAccuracy]:
    """Measure all conditions."""
    return {name: measure(*condition) for name, condition in CONDITIONS.items()}


if __name__ == "__main__":
    found = measured()
    print(table(found))
    print("ms a frame:", {name: round(m.extra_ms, 1) for name, m in found.items()})
