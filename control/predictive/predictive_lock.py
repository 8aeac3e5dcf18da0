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
    The parts: control/predictive/{transmission_model,prediction,reference_play,handle_motion}.py.
    Relating frames to the robot at their exposure: P. I. Corke, Visual Control of Robots, 1996.
"""

from __future__ import annotations

from math import hypot, isfinite

import numpy as np

from endolock.control.predictive import (
    handle_motion,
    increment_fit,
    predictive_memory,
    target_search,
)
from endolock.control.predictive.predictive_memory import (
    ERROR_VARIANCE,
    PREVIEW_S,
    PredictiveMemory,
)
from endolock.control.predictive.predictive_settings import PredictiveSettings
from endolock.control.predictive.reference_play import ReferencePlay
from endolock.control.predictive.seen_frames import SeenFrame
from endolock.control.predictive.servo_droop import ServoDroop
from endolock.control.predictive.wiring_check import WiringCheck
from endolock.control.transmission import kinematics
from endolock.control.transmission.kinematics import Pair, SectionGeometry
from endolock.control.transmission.linear_process import BEND_PER_HANDLE
from endolock.hw.api import Calibration, Command, State, Vector
from endolock.vision import camera_model
from endolock.vision.observation import Observation, Status

FAR_RAD = 0.35
"""Offset from the axis above which the target is not predicted without a background [rad]: the
model must be wrong."""


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
        self.memory: PredictiveMemory = predictive_memory.fresh(self._settings, 0.0, (0.0, 0.0))

    @property
    def signals(self) -> dict[str, float]:
        """Present and desired bend, loops and latency with uncertainty, play, models in use."""
        return self.memory.signals

    def reset(self, state: State) -> None:
        """Start from nothing, with the plays centred on the present goals of the handles."""
        self._wiring = WiringCheck(self._geometry)
        self.memory = predictive_memory.fresh(
            self._settings, state.t, (state.goal[0], state.goal[1])
        )

    def resume(self, state: State) -> None:
        """Go on with what is known of the transmission; where the target was is out of date."""
        memory = self.memory
        memory.t = state.t
        memory.goals = state.goal[0], state.goal[1]
        memory.servos = ServoDroop(), ServoDroop()
        memory.cautious.stop()
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
            memory.model_changed(before, self._settings.noise_px)
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

    def _see(self, t: float, observation: Observation) -> None:
        """Reconstruct where the target was at the exposure."""
        memory, settings, model = self.memory, self._settings, self.memory.model
        if observation.status is not Status.TRACKING:
            if observation.status is Status.LOST and memory.lost_s is None and memory.plays:
                memory.lost_s = t
                memory.cautious.stop()
                up_down, left_right = model.to_wires(
                    np.subtract(memory.target.at(t), memory.target.stays_at())
                ).tolist()
                memory.heading = up_down, left_right
            model.tip_at(observation.t_capture, observation.turn)
            self._check_wiring(observation, None)
            return
        memory.lost_s = memory.preview = None
        if isfinite(observation.distance_m):
            memory.distance_m = observation.distance_m
        depth = memory.distance_m or settings.target_distance_m
        tip = model.tip_at(observation.t_capture, observation.turn)
        bend = tip.bend
        up_down, left_right = bend.tolist()
        position, rotation = kinematics.forward(self._geometry, (up_down, left_right))
        ray = camera_model.ray(self._calibration, observation.target_px)
        place = kinematics.aim(self._geometry, position + rotation @ (depth * ray))
        self._check_wiring(observation, depth * ray)
        offset = np.array(place) - bend
        memory.off_rad = hypot(*offset.tolist())
        exposed = observation.t_capture + model.shift_s
        model.add(SeenFrame(observation.t_capture, bend, offset, tip.columns, tip.turned))
        lever = self._geometry.bending_length_m / 2 + self._geometry.rigid_tip_m
        memory.px_per_rad = self._calibration.focal_px * (depth + lever) / depth
        noise = max(_noise_px2(observation), settings.noise_px**2) / memory.px_per_rad**2
        late = 0.0
        if not model.background:
            late = (settings.latency_uncertainty_s * memory.rate * BEND_PER_HANDLE) ** 2
        horizon_s = t - exposed + settings.lead_s
        off = bend - tip.model
        memory.target.update(exposed, place, (noise + late, noise + late), horizon_s)
        if model.background:
            first, second = off.tolist()
            memory.error.update(exposed, (first, second), (ERROR_VARIANCE,) * 2, horizon_s)
        apparent = model.to_wires(np.array(place) - (off if model.background else 0.0))
        wires_offset = model.to_wires(offset).tolist()
        if memory.plays is None:
            start = model.bend.tolist()
            memory.plays = ReferencePlay(start[0]), ReferencePlay(start[1])
        for play, seen, apart in zip(memory.plays, apparent.tolist(), wires_offset, strict=True):
            off_axis = None if model.background else apart
            known = memory.cautious.place is None
            play.judge(exposed, seen, off_axis, memory.px_per_rad, known=known)

    def _check_wiring(self, observation: Observation, target: Vector | None) -> None:
        """Show the wiring check what was measured in a frame."""
        noise = max(_noise_px2(observation), self._settings.noise_px**2)
        turn, turned = observation.turn, self.memory.model.turned_rad
        spread = (turn.covariance[0][0] + turn.covariance[1][1]) / 2 if turn else 0.0
        variances = noise / self._calibration.focal_px**2, spread
        self._wiring.look(observation.t_capture, target, turned, variances)

    def _aim(self, t: float, dt: float) -> None:
        """Move the goals of the handles towards the predicted target, or a search."""
        memory, model = self.memory, self.memory.model
        assert memory.plays is not None
        if memory.lost_s is not None:
            last = memory.plays[0].place, memory.plays[1].place
            usual = memory.plays[0].usual, memory.plays[1].usual
            place = target_search.place(
                last, usual, memory.heading, t - memory.lost_s, self._half_view
            )
            wanted = soon = place
            speeds = (target_search.HANDLE_SPEED_RAD_S,) * 2
        else:
            wanted, soon = self._desired(t, dt)
            present, expected = model.bend.tolist(), memory.target.error_rad
            speeds = (
                handle_motion.speed(wanted[0] - present[0], expected[0]),
                handle_motion.speed(wanted[1] - present[1], expected[1]),
            )
        memory.goals = handle_motion.next_goals(
            memory.goals, model, memory.plays, wanted, soon, speeds=speeds, dt=dt
        )

    def _desired(self, t: float, dt: float) -> tuple[Pair, Pair]:
        """Bends that the model is to have, and a loop's crossing later, in axes of the wires."""
        memory, model = self.memory, self.memory.model
        assert memory.plays is not None
        when = t + self._settings.lead_s
        if model.background or (model.known and memory.off_rad < FAR_RAD):
            if memory.cautious.place is not None:
                memory.cautious.stop()
                for play in memory.plays if not model.background else ():
                    play.learn_anew()
            seen = model.to_wires(np.array(memory.foreseen(when))).tolist()
        else:
            target = model.to_wires(np.array(memory.target.stays_at()))
            place = memory.cautious.follow(t, target, model.bend, memory.off_rad)
            up_down, left_right = place.tolist()
            seen = [(up_down, left_right)] * len(PREVIEW_S)
        likely = model.likely_widths
        slopes, widths = model.slopes.tolist(), likely.tolist()
        early = handle_motion.foreseen_s(likely)
        wanted, soon = [], []
        for axis, play in enumerate(memory.plays):
            path = [place[axis] for place in seen]
            slope, width = slopes[axis], widths[axis]
            mean = sum(path) / len(path)
            wanted.append(play.follow(when, path[0], mean, dt=dt, slope=slope, width=width))
            moments = early[axis] / 2, early[axis]
            soon.append(play.ahead(np.interp(moments, PREVIEW_S, path).tolist()))
        return (wanted[0], wanted[1]), (soon[0], soon[1])


def _noise_px2(observation: Observation) -> float:
    """Mean variance of the target's coordinates [px2]; 0 where it is not known."""
    uu, _, vv = observation.covariance
    return (uu + vv) / 2 if isfinite(uu + vv) else 0.0
