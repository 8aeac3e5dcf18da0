"""State of the predictive lock, and the signals that show it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from endolock.control.predictive.cautious_following import CautiousFollowing
from endolock.control.predictive.prediction import TargetPrediction
from endolock.control.predictive.predictive_settings import PredictiveSettings
from endolock.control.predictive.reference_play import ReferencePlay
from endolock.control.predictive.servo_droop import ServoDroop
from endolock.control.predictive.transmission_model import TransmissionModel
from endolock.control.transmission.kinematics import Pair
from endolock.hw.api import AXES, Vector

PREVIEW_S = (0.0, 0.1, 0.2, 0.3)
"""Moments of the preview, after that for which the target is predicted [s]."""
ERROR_VARIANCE = 1e-6
"""Variance of a measured error of the model [rad2]. Assumed: 1 mrad."""


@dataclass
class PredictiveMemory:
    """State of the controller."""

    model: TransmissionModel
    """Model of the transmission."""
    target: TargetPrediction
    """Prediction of the target's place."""
    error: TargetPrediction
    """Prediction of the model's error."""
    goals: Pair
    """Goals of the handles, without droop correction [rad]."""
    plays: tuple[ReferencePlay, ReferencePlay] | None = None
    """Reference plays of both axes; None before the first frame."""
    servos: tuple[ServoDroop, ServoDroop] = field(
        default_factory=lambda: (ServoDroop(), ServoDroop())
    )
    """What the servos stop short of their goals."""
    distance_m: float | None = None
    """Depth of the target, as last measured by markers [m]."""
    preview: list[Pair] | None = None
    """How much further the bend is to be at `PREVIEW_S` [rad]; None if that was not computed since
    the newest frame."""
    cautious: CautiousFollowing = field(default_factory=CautiousFollowing)
    """Slow following while the model is not known."""
    px_per_rad: float = 350.0
    """Pixels per bend, at the target's depth [px/rad]."""
    rate: float = 0.0
    """Speed of the handles, both together [rad/s]."""
    off_rad: float = 0.0
    """Offset of the target from the axis in the newest frame [rad]."""
    t: float | None = None
    """Time of the last tick [s]."""
    lost_s: float | None = None
    """Time at which the target was lost; None while it is not [s]."""
    heading: Pair = field(default=(0.0, 0.0))
    """Direction in which the target was moving when it was lost."""

    @property
    def signals(self) -> dict[str, float]:
        """Present and desired bend, loops and latency with uncertainty, play, models in use."""
        model = self.model
        signals: dict[str, float] = {}
        bend, widths = model.bend, model.widths
        for n, name in enumerate(AXES):
            signals[f"bend_{name}_rad"] = float(bend[n])
            if self.plays:
                signals[f"target_{name}_rad"] = self.plays[n].place
                signals[f"reach_{name}_rad"] = self.plays[n].reach_rad
            signals[f"width_{name}_rad"] = float(widths[n])
            signals[f"width_std_{name}_rad"] = float(model.width_std[n])
            signals[f"expected_{name}_rad"] = self.target.error_rad[n]
        signals["latency_off_s"] = -model.shift_s
        signals["latency_std_s"] = model.shift_std_s
        signals["capstan"] = float(model.capstan_used)
        signals["background"] = float(model.background)
        signals["unexplained_rad"] = model.error_rad
        return signals

    def wanted(self, t: float) -> Pair:
        """Bend that the model is to have at a time [rad]."""
        wanted = self.target.at(t)
        if not self.model.background:
            return wanted
        off = self.error.at(t)
        return wanted[0] - off[0], wanted[1] - off[1]

    def foreseen(self, when: float) -> list[Pair]:
        """Bends that the model is to have at the moments of the preview [rad].

        Between frames all but the first move along with it.

        Args:
            when: first of these moments [s].
        """
        up_down, left_right = self.wanted(when)
        if self.preview is None:
            later = [self.wanted(when + after) for after in PREVIEW_S[1:]]
            self.preview = [(0.0, 0.0), *((a - up_down, b - left_right) for a, b in later)]
        return [(up_down + a, left_right + b) for a, b in self.preview]

    def model_changed(self, before: Vector, noise_px: float) -> None:
        """Let the predictions follow a change of the model, without a step of the handles.

        Args:
            before: present bend by the old model, in axes of the wires, 2 [rad].
            noise_px: standard deviation of the target's coordinates [px].
        """
        model = self.model
        self.preview = None
        by = model.bend - before
        for play, one in zip(self.plays or (), by.tolist(), strict=False):
            play.move(one)
        self.cautious.move(by)
        if not model.frames:
            return
        times = np.array([frame.t for frame in model.frames]) + model.shift_s
        bends = model.bends_at(times)
        if model.background:
            measured = np.array([frame.bend for frame in model.frames])
            self.error.rewrite(times, measured - bends, (ERROR_VARIANCE,) * 2)
            return
        offsets = np.array([frame.offset for frame in model.frames])
        noise = (noise_px / self.px_per_rad) ** 2
        self.target.rewrite(times, bends + offsets, (noise, noise))


def fresh(settings: PredictiveSettings, t: float, handles: Pair) -> PredictiveMemory:
    """Memory at the start.

    Args:
        settings: prior knowledge.
        t: present time [s].
        handles: present handle angles, at which everything is at rest [rad].
    """
    model = TransmissionModel(
        t,
        handles,
        capstan=settings.capstan,
        dead_zones=settings.dead_zones,
        background=settings.background,
    )
    target = TargetPrediction(
        walk_density=settings.walk_density,
        densities=settings.densities,
        harmonic=settings.harmonic,
        regression=settings.regression,
    )
    error = TargetPrediction(
        walk_density=settings.walk_density,
        densities=(),
        harmonic=settings.harmonic,
        regression=False,
        leader=target,  # the handles move with its periods
    )
    return PredictiveMemory(model, target, error, goals=handles)
