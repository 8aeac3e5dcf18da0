"""Predictive lock: reconstructs past places of the target, predicts the next one, and aims at it.

1. A model of the transmission runs on the measured handle angles.
2. The background in the video tells how the tip turned from frame to frame. Summed, these turns are
   the tip's bend, up to a slow drift; without a background the model's bend is taken instead.
3. A frame shows the target's offset from the axis at its exposure. Added to the bend at that time
   it gives the target's place, in bend angles, for any latency.
4. The place is predicted over the latency and the lag of servo and tip, and so is the model's
   error, the measured bend minus the model's; their difference is the bend that the model is to
   have.
5. A reference play, as wide as its price demands, holds the handles where motion gains nothing. The
   model's inverse gives handle angles, which are approached at a limited speed. A turn of the
   target that is foreseen starts the way through the loop early.
6. The model starts with no hysteresis and is believed as far as it explains newer frames.

It needs neither the latency nor the width of the hysteresis, only what is known on a bench.

Reference:
    The parts: control/predictive/{transmission_model,prediction,reference_play}.py. Relating frames
    to the robot at their exposure: P. I. Corke, Visual Control of Robots, 1996.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import hypot, isfinite, pi

import numpy as np

from endolock.control.predictive import increment_fit, target_search
from endolock.control.predictive.prediction import TargetPrediction
from endolock.control.predictive.predictive_settings import PredictiveSettings
from endolock.control.predictive.reference_play import ReferencePlay
from endolock.control.predictive.servo_droop import ServoDroop
from endolock.control.predictive.transmission_model import SeenFrame, TransmissionModel
from endolock.control.predictive.wiring_check import WiringCheck
from endolock.control.transmission import kinematics
from endolock.control.transmission.kinematics import Pair, SectionGeometry
from endolock.control.transmission.linear_process import BEND_PER_HANDLE
from endolock.hw.api import AXES, Calibration, Command, State, Vector
from endolock.vision import camera_model
from endolock.vision.observation import Observation, Status

FAR_RAD = 0.35
"""Offset from the axis above which the target is not predicted without a background [rad]: the
model must be wrong."""
SPEED_RAD_S, HURRY = 1.9, 2.0
"""Speed at which the handles cross their loops [rad/s], and factor on it while the tip is more than
`HURRY_RAD` off. Assumed: half of what the servos of the thesis can do."""
HURRY_RAD = 0.15
"""Distance from the desired bend above which the handles hurry [rad]."""
SLACK_RAD, SLACK_SHARE = 0.004, 0.5
"""Distance of the bend beyond the desired one that does not turn a handle back [rad], and the same
in reaches of the reference play [1]. Assumed: a pixel."""
UNSURE_RAD = 0.012
"""Expected error of the prediction above which the speed rises in proportion [rad]: turns are not
foreseen then."""
EARLY = 0.35
"""Part of a loop that is left to cross when a foreseen turn comes [1]. Source: tuned on strokes."""
LONGEST_S = 0.35
"""Longest time that a turn is foreseen [s]."""
PREVIEW = np.array([0.0, 1 / 3, 2 / 3, 1.0])
"""Moments of the preview, in parts of `PREVIEW_S` [1]."""
PREVIEW_S = 0.3
"""Length of the preview [s]."""
CAUTION_S, CAUTIOUS_RAD = 1.0, (0.08, 0.2)
"""Time constant with which the target is followed while the model is not known [s], and offsets
from the axis up to which this holds and from which on it is followed at once [rad]. Assumed: twice
the latency, so that the loop is stable without a model; a handle that goes far passes its loop."""
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
    cautious: Vector | None = None
    """Slowly followed place while the model is not known; None while it is [rad]."""
    cautious_s: float = 0.0
    """Time of that place [s]."""
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
        self._half_view = target_search.half_view_rad(calibration)
        increment_fit.prepare()
        self._wiring = WiringCheck(self._geometry)
        self.memory = self._fresh(0.0, (0.0, 0.0))

    @property
    def signals(self) -> dict[str, float]:
        """Present and desired bend, loops and latency with uncertainty, play, models in use."""
        memory, model = self.memory, self.memory.model
        signals: dict[str, float] = {}
        bend, widths = model.bend, model.widths
        for n, name in enumerate(AXES):
            signals[f"bend_{name}_rad"] = float(bend[n])
            if memory.plays:
                signals[f"target_{name}_rad"] = memory.plays[n].place
                signals[f"reach_{name}_rad"] = memory.plays[n].reach_rad
            signals[f"width_{name}_rad"] = float(widths[n])
            signals[f"width_std_{name}_rad"] = float(model.width_std[n])
            signals[f"expected_{name}_rad"] = memory.target.error_rad[n]
        signals["latency_off_s"] = -model.shift_s
        signals["latency_std_s"] = model.shift_std_s
        signals["capstan"] = float(model.capstan_used)
        signals["background"] = float(model.background)
        signals["unexplained_rad"] = model.error_rad
        return signals

    def reset(self, state: State) -> None:
        """Start from nothing at the present handle angles, with the plays centred on them."""
        self._wiring = WiringCheck(self._geometry)
        self.memory = self._fresh(state.t, (state.goal[0], state.goal[1]))

    def resume(self, state: State) -> None:
        """Go on with what is known of the transmission; where the target was is out of date."""
        memory = self.memory
        memory.t = state.t
        memory.goals = state.goal[0], state.goal[1]
        memory.servos = ServoDroop(), ServoDroop()
        if memory.plays:
            for play, bend in zip(memory.plays, memory.model.bend.tolist(), strict=True):
                play.restart(bend)

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Simulate, learn, predict and aim; search for a lost target.

        See `Controller.update`.

        Raises:
            WiringError: a handle turns the tip the wrong way, or about the other axis.
        """
        memory = self.memory
        dt = min(max(t - memory.t, 0.0), 0.1) if memory.t is not None else 0.0
        memory.t = t
        handles = state.position[0], state.position[1]
        memory.model.follow(state.t, handles)
        self._wiring.follow(state.t, handles)
        memory.rate = hypot(*state.velocity)
        if observation is not None:
            self._see(t, observation)
        memory.target.work()
        memory.error.work()
        before = memory.model.bend
        changed = memory.model.learn(t) if observation is not None else False
        if memory.model.work() or changed:
            self._change(before)
        if memory.plays is None or dt == 0.0:
            return Command(position=memory.goals)
        for servo, old, position, rate in zip(
            memory.servos, memory.goals, state.position, state.velocity, strict=True
        ):
            servo.measure(old, position, rate, dt)
        self._aim(t, dt)
        return Command(
            position=[
                servo.corrected(goal)
                for servo, goal in zip(memory.servos, memory.goals, strict=True)
            ]
        )

    def _fresh(self, t: float, handles: Pair) -> PredictiveMemory:
        settings = self._settings
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
        )
        return PredictiveMemory(model, target, error, goals=handles)

    def _see(self, t: float, observation: Observation) -> None:
        """Reconstruct where the target was at the exposure."""
        memory, settings, model = self.memory, self._settings, self.memory.model
        if observation.status is not Status.TRACKING:
            if observation.status is Status.LOST and memory.lost_s is None and memory.plays:
                memory.lost_s = t
            self._wiring.look(observation.t_capture, None, None, (0.0, 0.0))
            return
        memory.lost_s = None
        if isfinite(observation.distance_m):
            memory.distance_m = observation.distance_m
        depth = memory.distance_m or settings.target_distance_m
        bend, turned = model.tip_at(observation.t_capture, observation.turn)
        up_down, left_right = bend.tolist()
        position, rotation = kinematics.forward(self._geometry, (up_down, left_right))
        ray = camera_model.ray(self._calibration, observation.target_px)
        place = kinematics.aim(self._geometry, position + rotation @ (depth * ray))
        self._check_wiring(observation, depth * ray)
        offset = np.array(place) - bend
        memory.off_rad = float(np.hypot(*offset))
        exposed = observation.t_capture + model.shift_s
        columns = model.history.columns_at(np.array([exposed]))[0]
        model.add(SeenFrame(observation.t_capture, bend, offset, columns, turned))
        lever = self._geometry.bending_length_m / 2 + self._geometry.rigid_tip_m
        memory.px_per_rad = self._calibration.focal_px * (depth + lever) / depth
        noise = max(_noise_px2(observation), settings.noise_px**2) / memory.px_per_rad**2
        late = 0.0
        if not model.background:
            late = (settings.latency_uncertainty_s * memory.rate * BEND_PER_HANDLE) ** 2
        horizon_s = t - exposed + settings.lead_s
        off = bend - model.bends_at(np.array([exposed]))[0]
        memory.target.update(exposed, place, (noise + late, noise + late), horizon_s)
        if model.background:
            first, second = off.tolist()
            memory.error.update(exposed, (first, second), (ERROR_VARIANCE,) * 2, horizon_s)
        apparent = np.array(place) - (off if model.background else 0.0)
        if memory.plays is None:
            start = model.bend.tolist()
            memory.plays = ReferencePlay(start[0]), ReferencePlay(start[1])
        for play, seen, apart in zip(memory.plays, apparent.tolist(), offset.tolist(), strict=True):
            off_axis = None if model.background else apart
            play.judge(exposed, seen, off_axis, memory.px_per_rad)

    def _check_wiring(self, observation: Observation, target: Vector) -> None:
        """Show the wiring check what was measured in a frame."""
        noise = max(_noise_px2(observation), self._settings.noise_px**2)
        turn, turned = observation.turn, self.memory.model.turned_rad
        spread = (turn.covariance[0][0] + turn.covariance[1][1]) / 2 if turn else 0.0
        variances = noise / self._calibration.focal_px**2, spread
        self._wiring.look(observation.t_capture, target, turned, variances)

    def _wanted(self, t: float) -> Vector:
        """Bend that the model is to have at a time, 2 [rad]."""
        memory, model = self.memory, self.memory.model
        if model.background:
            wanted: Vector = np.subtract(memory.target.at(t), memory.error.at(t))
        else:
            wanted = np.array(memory.target.at(t))
        return wanted

    def _cautiously(self, t: float) -> Vector:
        """Bend to have while neither background nor model can be relied on, 2 [rad].

        Prediction without a model of hysteresis oscillates, and a wrong model loses the target.
        """
        memory, model = self.memory, self.memory.model
        place = np.array(memory.target.stays_at())
        near, far = CAUTIOUS_RAD
        patience_s = CAUTION_S * min(max((far - memory.off_rad) / (far - near), 0.0), 1.0)
        before = model.bend if memory.cautious is None else memory.cautious
        dt = max(t - memory.cautious_s, 0.0) if memory.cautious is not None else 0.0
        share = dt / max(dt, patience_s) if dt > 0 else 0.0
        memory.cautious, memory.cautious_s = before + share * (place - before), t
        return memory.cautious

    def _aim(self, t: float, dt: float) -> None:
        """Move the goals of the handles towards the predicted target, or a search."""
        memory, model = self.memory, self.memory.model
        assert memory.plays is not None
        when = t + self._settings.lead_s
        slopes, widths = model.slopes, model.widths
        early = np.minimum(widths / SPEED_RAD_S, LONGEST_S)
        wanted, soon = np.empty(2), np.empty(2)
        if memory.lost_s is not None:
            last = memory.plays[0].place, memory.plays[1].place
            place = target_search.place(last, memory.heading, t - memory.lost_s, self._half_view)
            wanted[:] = soon[:] = place
        else:
            if model.background or (model.known and memory.off_rad < FAR_RAD):
                memory.cautious = None
                seen = np.array([self._wanted(when + part * PREVIEW_S) for part in PREVIEW])
            else:
                seen = np.repeat([self._cautiously(t)], len(PREVIEW), axis=0)
            for axis, play in enumerate(memory.plays):
                wanted[axis] = play.follow(
                    when,
                    float(seen[0, axis]),
                    float(seen[:, axis].mean()),
                    dt=dt,
                    slope=float(slopes[axis]),
                    width=float(widths[axis]),
                )
                part = early[axis] / PREVIEW_S
                aims = np.interp([part / 2, part], PREVIEW, seen[:, axis])
                soon[axis] = play.ahead(aims.tolist())
        present = model.bend
        now = model.handles_for(wanted, pi)
        facing = memory.plays[0].direction, memory.plays[1].direction
        turns = ((soon - present) * facing < 0).any()
        then = model.handles_for(soon, pi) if turns else now
        goals = []
        for axis, play in enumerate(memory.plays):
            old, goal, ahead = memory.goals[axis], now[axis], then[axis]
            handle, way = float(model.history.handles[axis]), facing[axis]
            beyond = abs(float(wanted[axis] - present[axis]))
            if (ahead - handle) * way < 0 <= (goal - handle) * way:  # a turn is foreseen
                left = EARLY * SPEED_RAD_S * float(early[axis])
                goal = min(max(goal, ahead - left), ahead + left)
            elif (goal - old) * way < 0 and beyond < max(SLACK_RAD, SLACK_SHARE * play.reach_rad):
                goal = old  # not worth the way back through the loop
            hurry = HURRY if beyond > HURRY_RAD else 1.0
            speed = SPEED_RAD_S * max(hurry, memory.target.error_rad[axis] / UNSURE_RAD)
            if memory.lost_s is not None:
                speed = target_search.HANDLE_SPEED_RAD_S
            step = speed * dt
            goals.append(min(max(goal, old - step, -pi), old + step, pi))
        memory.goals = goals[0], goals[1]

    def _change(self, before: Vector) -> None:
        """Let the predictions follow a change of the model, without a step of the handles.

        Args:
            before: present bend by the old model [rad].
        """
        memory, model = self.memory, self.memory.model
        by = model.bend - before
        for play, one in zip(memory.plays or (), by.tolist(), strict=False):
            play.move(one)
        if memory.cautious is not None:
            memory.cautious = memory.cautious + by
        if not model.frames:
            return
        times = np.array([frame.t for frame in model.frames]) + model.shift_s
        bends = model.bends_at(times)
        if model.background:
            measured = np.array([frame.bend for frame in model.frames])
            errors = [(a, b) for a, b in (measured - bends).tolist()]
            memory.error.rewrite(times.tolist(), errors, (ERROR_VARIANCE,) * 2)
            return
        offsets = np.array([frame.offset for frame in model.frames])
        places = [(a, b) for a, b in (bends + offsets).tolist()]
        noise = (self._settings.noise_px / memory.px_per_rad) ** 2
        memory.target.rewrite(times.tolist(), places, (noise, noise))


def _noise_px2(observation: Observation) -> float:
    """Mean variance of the target's coordinates [px2]; 0 where it is not known."""
    uu, _, vv = observation.covariance
    return (uu + vv) / 2 if isfinite(uu + vv) else 0.0
