"""Predictive lock: reconstructs past target positions, predicts the next one, and aims at it.

1. A model of the transmission runs on the measured handle angles.
2. A frame shows the target's offset from the axis at its exposure. Added to the model's bend at
   that time it gives the target's position, in bend angles, for any latency.
3. Predictors extrapolate it over the latency and the lag of servo and tip.
4. The model's inverse, after a small reference play, converts the desired bend to handle angles.
5. The model starts with almost no hysteresis. It is identified continuously, together with the
   latency; the target's past is recomputed with each result.
6. If the handles reverse too often, the controller becomes cautious: it reverses only for larger
   changes.

It needs neither the latency nor the width of the hysteresis, only what is known on a bench.

Reference:
    The parts: control/predictive/internal_model.py and control/predictive/target_prediction.py.
    Relating frames to the robot at their exposure: P. I. Corke, Visual Control of Robots, 1996.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import hypot, isfinite, pi

import numpy as np

from endolock.control.predictive import online_plays
from endolock.control.predictive.internal_model import MIN_FRAMES, InternalModel, at_rest
from endolock.control.predictive.predictive_settings import PredictiveSettings
from endolock.control.predictive.reversals import Reversals
from endolock.control.predictive.target_prediction import SURE, SURE_AGAIN, Bank, Harmonic, Mover
from endolock.control.transmission import kinematics
from endolock.control.transmission.kinematics import Pair, SectionGeometry
from endolock.control.transmission.linear_process import BEND_PER_HANDLE
from endolock.control.transmission.plays import play_step
from endolock.hw.api import AXES, Calibration, Command, State
from endolock.vision import camera_model
from endolock.vision.observation import Observation, Status

MIN_REVERSALS = 2
"""Reversals needed before the model is used: hysteresis shows only there."""
FAR_RAD = 0.35
"""Offset from the axis above which the target is not predicted [rad]: the model must be wrong."""
STILL_RAD_S, DROOP_RAD, DROOP_GAIN = 0.05, 0.02, 0.02
"""Speed below which a handle stands still [rad/s], largest steady-state error of its servo [rad],
and fraction of it that is added to the goal each tick. Assumed: 8 mrad are measured on the twin."""
CAUTION = 4.0
"""Factor on the reference play while cautious."""


@dataclass
class PredictiveMemory:
    """State of the controller."""

    bank: Bank
    """Predictors of the target."""
    model: InternalModel = field(default_factory=InternalModel)
    """Model of the transmission."""
    goals: Pair = (0.0, 0.0)
    """Goals of the handles, without droop correction [rad]."""
    droop: Pair = (0.0, 0.0)
    """Steady-state error of the servos, added to the goals [rad]."""
    desired_bend: Pair | None = None
    """Desired bend, after the reference play [rad]."""
    seen: list[tuple[float, float, float]] = field(default_factory=list)
    """Believed exposure times [s] and offsets of the target from the axis [rad]."""
    distance_m: float | None = None
    """Depth of the target, as last measured by markers [m]."""
    identified_s: float = 0.0
    """Time of the last identification [s]."""
    known: bool = False
    """Whether hysteresis was identified from motion with reversals."""
    rate: float = 0.0
    """Speed of the handles, both together [rad/s]."""
    off_rad: float = 0.0
    """Offset of the target from the axis in the newest frame [rad]."""
    lost: bool = False
    """Whether the target is lost."""
    reversals: Reversals = field(default_factory=Reversals)
    """Reversals of the goals."""


class Predictive:
    """Predictive controller of both axes.

    Args:
        calibration: turns pixels into rays.
        settings: prior knowledge; the defaults if None.
        geometry: lengths of the section; the defaults if None.
    """

    def __init__(
        self,
        calibration: Calibration,
        settings: PredictiveSettings | None = None,
        geometry: SectionGeometry | None = None,
    ) -> None:
        self._calibration = calibration
        self._settings = settings or PredictiveSettings()
        self._geometry = geometry or SectionGeometry()
        online_plays.prepare()
        self.memory = self._fresh((0.0, 0.0))

    @property
    def signals(self) -> dict[str, float]:
        """Present and desired bend, widths and latency with uncertainty, models in use, caution."""
        memory = self.memory
        signals: dict[str, float] = {}
        model = memory.model
        for n, (name, axis) in enumerate(zip(AXES, model.axes, strict=True)):
            signals[f"bend_{name}_rad"] = model.bend[n]
            if memory.desired_bend:
                signals[f"target_{name}_rad"] = memory.desired_bend[n]
            signals[f"width_{name}_rad"] = axis.width
            signals[f"width_std_{name}_rad"] = axis.width_std
        signals["latency_off_s"] = -model.shift
        signals["latency_std_s"] = model.shift_std_s
        signals["capstan"] = float(model.capstan_used)
        signals["predictor"] = float(memory.bank.chosen)
        signals["cautious"] = float(memory.reversals.cautious)
        return signals

    def reset(self, state: State) -> None:
        """Start again from the present handle angles, with the plays centred on them."""
        self.memory = self._fresh((state.position[0], state.position[1]))

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Simulate, identify, predict and aim; hold while the target is lost.

        See `Controller.update`.
        """
        memory, settings = self.memory, self._settings
        memory.model.follow(state)
        memory.rate = hypot(*state.velocity)
        if observation is not None:
            memory.lost = observation.status is Status.LOST
            if observation.status is Status.TRACKING:
                self._add_frame(t, observation)
        if t - memory.identified_s >= settings.identify_every_s and len(memory.seen) >= MIN_FRAMES:
            memory.identified_s = t
            if memory.model.identify(np.array(memory.seen), settings.damping):
                if not memory.known:
                    memory.bank.forget(SURE)  # predictions made without a model do not count
                memory.known = memory.reversals.total >= MIN_REVERSALS
                self._recompute_past()
        if settings.capstan and memory.known:
            capstan_used = memory.model.capstan_used
            if memory.model.look_for_capstan(memory.seen):
                self._recompute_past()
            if memory.model.capstan_used is not capstan_used:
                memory.bank.forget(SURE_AGAIN)
        if memory.bank.t is None or memory.lost:
            return Command(position=memory.goals)
        memory.desired_bend = self._desired_bend(t)
        up_down, left_right = memory.model.handles_for(memory.desired_bend)
        memory.goals = min(max(up_down, -pi), pi), min(max(left_right, -pi), pi)
        memory.reversals.update(
            t, memory.goals, swing_rad=settings.swing_rad, busy_per_s=settings.busy_per_s
        )
        droop = []
        for old, goal, position, rate in zip(
            memory.droop, state.goal, state.position, state.velocity, strict=True
        ):
            # A servo without integral action stops short of its goal under load.
            error = min(max(goal - position - old, -DROOP_RAD), DROOP_RAD)
            droop.append(old + DROOP_GAIN * error if abs(rate) < STILL_RAD_S else old)
        memory.droop = droop[0], droop[1]
        return Command(position=[g + d for g, d in zip(memory.goals, memory.droop, strict=True)])

    def _fresh(self, handles: Pair) -> PredictiveMemory:
        settings = self._settings
        movers = [Mover(density) for density in settings.densities]
        if settings.harmonic or len(movers) > 1:
            movers.insert(0, Mover(settings.walk_density, still=True))
        bank = Bank(movers, Harmonic() if settings.harmonic else None)
        return PredictiveMemory(
            bank, model=at_rest(handles), goals=handles, reversals=Reversals(extremes=handles)
        )

    def _add_frame(self, t: float, observation: Observation) -> None:
        """Reconstruct where the target was at the exposure."""
        memory, settings = self.memory, self._settings
        if isfinite(observation.distance_m):
            memory.distance_m = observation.distance_m
        depth = memory.distance_m or settings.target_distance_m
        exposed = observation.t_capture + memory.model.shift
        bend = memory.model.bend_at(exposed)
        position, rotation = kinematics.forward(self._geometry, bend)
        ray = camera_model.ray(self._calibration, observation.target_px)
        target = kinematics.aim(self._geometry, position + rotation @ (depth * ray))
        offset = target[0] - bend[0], target[1] - bend[1]
        memory.seen.append((observation.t_capture, *offset))
        rotated = memory.model.rotated(offset)
        target = bend[0] + rotated[0], bend[1] + rotated[1]
        memory.off_rad = hypot(*offset)
        while memory.seen[0][0] < t - online_plays.WINDOW_S:
            del memory.seen[0]
        noise = settings.noise_px / self._calibration.focal_px
        late = settings.latency_uncertainty_s * memory.rate * BEND_PER_HANDLE
        horizon_s = t - exposed + settings.lead_s
        memory.bank.update(exposed, target, noise**2 + late**2, horizon_s)

    def _desired_bend(self, t: float) -> Pair:
        """Predict the target, and return its bend after the reference play [rad]."""
        memory, settings = self.memory, self._settings
        reach = settings.reversal_rad
        # Prediction without a model of hysteresis oscillates, and a wrong model loses the target.
        good = memory.known and memory.off_rad < FAR_RAD
        aim = memory.bank.at(t + settings.lead_s) if good else memory.bank.movers[0].position
        if memory.reversals.cautious:
            reach *= CAUTION
        before = memory.desired_bend or aim
        up_down, left_right = (play_step(b, a, reach) for b, a in zip(before, aim, strict=True))
        return up_down, left_right

    def _recompute_past(self) -> None:
        """Recompute the target's past with the present model."""
        memory = self.memory
        known = [frame for frame in memory.seen if frame[0] > memory.model.since]
        t, *offset = np.array(known).T
        exposed = t + memory.model.shift
        up_down, left_right = memory.model.rotated((offset[0], offset[1]))
        past = memory.model.bends_at(exposed) + np.column_stack([up_down, left_right])
        noise = self._settings.noise_px / self._calibration.focal_px
        positions = [(float(x), float(y)) for x, y in past]
        memory.bank.rewrite(exposed.tolist(), positions, noise**2)
        memory.desired_bend = memory.model.bend  # so the reference play starts from the new model
