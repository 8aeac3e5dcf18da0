"""The predictive lock: when was it seen, where was the tip then, where will the target be.

1. A model of the transmission runs forward on the measured handles.
2. A frame tells by how much the target lay off the axis at its exposure; added to the bend that the
   model had then, this is where the target was, in bend angles, whatever the latency.
3. Predictors carry it over the latency and the lag of servo and tip.
4. The model's inverse, behind a small reference play, turns the wanted bend into a handle angle.
5. The model begins with almost no hysteresis. It is identified all the time, the latency with it,
   and the target's past is told again with what was found.
6. Where the handles turn back too often, the law becomes cautious: it turns back only for more.

It needs neither a known latency nor a known width, nothing but what a bench knows.

Reference:
    The parts: control/predictive/internal_model.py and control/predictive/target_prediction.py.
    Relating frames to the robot at their exposure: P. I. Corke, Visual Control of Robots, 1996.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import hypot, isfinite, pi

import numpy as np

from endolock.control.predictive import online_plays
from endolock.control.predictive.internal_model import MIN_FRAMES, InternalModel, started
from endolock.control.predictive.target_prediction import SURE, SURE_AGAIN, Bank, Harmonic, Mover
from endolock.control.transmission import kinematics
from endolock.control.transmission.kinematics import Pair, SectionGeometry
from endolock.control.transmission.linear_process import BEND_PER_HANDLE, HOLD_S, LAG_S
from endolock.control.transmission.plays import play_step
from endolock.hw.api import AXES, Calibration, Command, ConfigError, State
from endolock.vision import camera_model
from endolock.vision.observation import Observation, Status

MIN_TURNS = 2
"""Reversals that must have been seen before the model is believed: the loop shows there alone."""
FAR_RAD = 0.35
"""A target that was so far off the axis is not predicted [rad]: the model must be wrong."""
STILL_RAD_S, SHORT_RAD, SHORT_SHARE = 0.05, 0.02, 0.02
"""Slower handles stand, and a servo stops short by that at most; so much of it is added each tick.
Assumed: 8 mrad are measured on the twin."""
CAUTION = 4.0
"""Factor on the reference play while cautious."""


@dataclass(frozen=True, kw_only=True)
class PredictiveSettings:
    """What the law believes, and how quickly it changes its mind."""

    target_distance_m: float = 0.12
    """Depth of the target until markers tell it [m], > 0. Source: 12 cm, thesis ch. 6."""
    walk_density: float = 0.02
    """Random walk of the target [rad2/s], > 0. Assumed."""
    densities: tuple[float, ...] = (0.02, 0.5)
    """White acceleration of each constant-velocity predictor [rad2/s3], > 0. Assumed: a target of
    slow and one of quick turns."""
    harmonic: bool = True
    """Whether periods are looked for."""
    noise_px: float = 0.5
    """Least standard deviation of what vision tells [px], > 0. Assumed: five times markers'."""
    latency_uncertainty_s: float = 0.02
    """Exposures are known to this [s]: while handles turn, frames are trusted less. Assumed."""
    lead_s: float = LAG_S + HOLD_S
    """Command to motion [s], >= 0: servo, tip, one and a half control periods."""
    reversal_rad: float = 0.001
    """Smaller changes of the wanted bend do not turn the handles back [rad], >= 0."""
    identify_every_s: float = 2.0
    """[s], > 0; more than the time of any run leaves the model as it begins."""
    capstan: bool = True
    """Whether a capstan model is looked for, besides the plays."""
    damping: float = 0.8
    """Share of the way from the old to the identified weights [1], 0 to 1."""
    busy_per_s: float = 3.0
    """More reversals of the handles a second make it cautious, until there are half as many.
    Assumed: strokes have 0.5."""
    swing_rad: float = 0.1
    """A handle has reversed once it came back by this [rad], > 0. Assumed: less is noise."""

    def __post_init__(self) -> None:
        positive = (self.target_distance_m, self.walk_density, *self.densities, self.noise_px)
        good = min(*positive, self.identify_every_s, self.busy_per_s) > 0
        good &= min(self.latency_uncertainty_s, self.lead_s, self.reversal_rad, self.damping) >= 0
        if not (good and self.densities and self.damping <= 1 and self.swing_rad > 0):
            raise ConfigError(
                "predictive: distance, densities, noise_px, identify_every_s and busy_per_s must "
                "be above 0, the rest 0 or more, damping at most 1"
            )


@dataclass(frozen=True, kw_only=True)
class SinglePredictiveSettings(PredictiveSettings):
    """The same with one constant-velocity predictor."""

    densities: tuple[float, ...] = (0.02,)
    """As above."""
    harmonic: bool = False
    """As above."""


@dataclass
class PredictiveMemory:
    """What the law remembers."""

    bank: Bank
    model: InternalModel = field(default_factory=InternalModel)
    held: Pair = (0.0, 0.0)
    """The last command [rad]."""
    droop: Pair = (0.0, 0.0)
    """What the servos stop short, added to the command [rad]."""
    wanted: Pair | None = None
    """Bend that is wanted, behind the reference play [rad]."""
    seen: list[tuple[float, float, float]] = field(default_factory=list)
    """Exposures as believed [s], and how far the target was off then [rad]."""
    distance_m: float | None = None
    identified: float = 0.0
    """When [s]."""
    known: bool = False
    """Whether the hysteresis was identified from a course with reversals."""
    rate: float = 0.0
    """Of the handles [rad/s]."""
    off_rad: float = 0.0
    """How far off the axis the target was in the newest frame [rad]."""
    lost: bool = False
    extremes: Pair = (0.0, 0.0)
    """Farthest commands since the last reversals [rad]."""
    ways: Pair = (0.0, 0.0)
    """Their directions, +1 or -1; 0 at first."""
    turns: list[float] = field(default_factory=list)
    """Times of the commands' reversals within the last 2 s [s]."""
    turned: int = 0
    """How many there were in all."""
    cautious: bool = False


class Predictive:
    """The law.

    Args:
        calibration: turns pixels into rays.
        settings: what it believes; the defaults if None.
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
        """Bend believed and wanted, widths, latency, what they are worth, predictor, caution."""
        memory = self.memory
        told: dict[str, float] = {}
        model = memory.model
        for n, (name, axis) in enumerate(zip(AXES, model.axes, strict=True)):
            told[f"bend_{name}_rad"] = model.bend[n]
            if memory.wanted:
                told[f"target_{name}_rad"] = memory.wanted[n]
            told[f"width_{name}_rad"] = axis.width
            told[f"width_std_{name}_rad"] = axis.width_std
        told["latency_off_s"] = -model.shift
        told["latency_std_s"] = model.shift_std_s
        told["capstan"] = float(model.believed)
        told["predictor"] = float(memory.bank.chosen)
        told["cautious"] = float(memory.cautious)
        return told

    def reset(self, state: State) -> None:
        """Begin anew where the handles are, the plays centred on them."""
        self.memory = self._fresh((state.position[0], state.position[1]))

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Follow, learn, predict, aim; hold where the target is lost. See `Controller.update`."""
        memory, settings = self.memory, self._settings
        memory.model.follow(state)
        memory.rate = hypot(*state.velocity)
        if observation is not None:
            memory.lost = observation.status is Status.LOST
            if observation.status is Status.TRACKING:
                self._take(t, observation)
        if t - memory.identified >= settings.identify_every_s and len(memory.seen) >= MIN_FRAMES:
            memory.identified = t
            if memory.model.identify(np.array(memory.seen), settings.damping):
                if not memory.known:
                    memory.bank.forget(SURE)  # what was said without a model says nothing
                memory.known = memory.turned >= MIN_TURNS
                self._tell_again()
        if settings.capstan and memory.known:
            believed = memory.model.believed
            if memory.model.look_for_capstan(memory.seen):
                self._tell_again()
            if memory.model.believed is not believed:
                memory.bank.forget(SURE_AGAIN)
        if memory.bank.t is None or memory.lost:
            return Command(position=memory.held)
        self._want(t)
        assert memory.wanted is not None
        one, other = memory.model.handles_for(memory.wanted)
        memory.held = min(max(one, -pi), pi), min(max(other, -pi), pi)
        self._count_turns(t)
        droop = []
        for old, goal, place, rate in zip(
            memory.droop, state.goal, state.position, state.velocity, strict=True
        ):
            # A servo without integral stops short under load, by what its encoder tells.
            short = min(max(goal - place - old, -SHORT_RAD), SHORT_RAD)
            droop.append(old + SHORT_SHARE * short if abs(rate) < STILL_RAD_S else old)
        memory.droop = droop[0], droop[1]
        return Command(position=[h + d for h, d in zip(memory.held, memory.droop, strict=True)])

    def _count_turns(self, t: float) -> None:
        """Notice reversals of the commands, and whether there are too many."""
        memory, settings = self.memory, self._settings
        extremes, ways = [], []
        for command, extreme, way in zip(memory.held, memory.extremes, memory.ways, strict=True):
            moved = command - extreme
            if way * moved >= 0 and (way or abs(moved) < settings.swing_rad):
                extreme = command if way else extreme
            elif abs(moved) >= settings.swing_rad:
                if way:
                    memory.turns.append(t)
                    memory.turned += 1
                extreme, way = command, 1.0 if moved > 0 else -1.0
            extremes.append(extreme)
            ways.append(way)
        memory.extremes, memory.ways = (extremes[0], extremes[1]), (ways[0], ways[1])
        memory.turns = [at for at in memory.turns if at > t - 2.0]
        limit = 2.0 * settings.busy_per_s
        memory.cautious = len(memory.turns) > (limit / 2 if memory.cautious else limit)

    def _fresh(self, handles: Pair) -> PredictiveMemory:
        settings = self._settings
        movers = [Mover(density) for density in settings.densities]
        if settings.harmonic or len(movers) > 1:
            movers.insert(0, Mover(settings.walk_density, still=True))
        bank = Bank(movers, Harmonic() if settings.harmonic else None)
        return PredictiveMemory(bank, model=started(handles), held=handles, extremes=handles)

    def _take(self, t: float, observation: Observation) -> None:
        """Work out where the target was."""
        memory, settings = self.memory, self._settings
        if isfinite(observation.distance_m):
            memory.distance_m = observation.distance_m
        depth = memory.distance_m or settings.target_distance_m
        exposed = observation.t_capture + memory.model.shift
        bend = memory.model.bend_at(exposed)
        position, rotation = kinematics.forward(self._geometry, bend)
        ray = camera_model.ray(self._calibration, observation.target_px)
        place = kinematics.aim(self._geometry, position + rotation @ (depth * ray))
        off = place[0] - bend[0], place[1] - bend[1]
        memory.seen.append((observation.t_capture, *off))
        turned = memory.model.turned(off)
        place = bend[0] + turned[0], bend[1] + turned[1]
        memory.off_rad = hypot(*off)
        while memory.seen[0][0] < t - online_plays.WINDOW_S:
            del memory.seen[0]
        noise = settings.noise_px / self._calibration.focal_px
        late = settings.latency_uncertainty_s * memory.rate * BEND_PER_HANDLE
        horizon_s = t - exposed + settings.lead_s
        memory.bank.update(exposed, place, noise**2 + late**2, horizon_s)

    def _want(self, t: float) -> None:
        """Predict, and let the wanted bend follow behind the reference play."""
        memory, settings = self.memory, self._settings
        reach = settings.reversal_rad
        # Prediction without a model of the hysteresis rings, and a wrong model loses the target.
        good = memory.known and memory.off_rad < FAR_RAD
        aim = memory.bank.at(t + settings.lead_s) if good else memory.bank.movers[0].place
        if memory.cautious:
            reach *= CAUTION
        before = memory.wanted or aim
        one, other = (play_step(w, a, reach) for w, a in zip(before, aim, strict=True))
        memory.wanted = one, other

    def _tell_again(self) -> None:
        """Tell the target's past again with the model as it is now."""
        memory = self.memory
        t, *off = np.array([one for one in memory.seen if one[0] > memory.model.since]).T
        moments = t + memory.model.shift
        one, other = memory.model.turned((off[0], off[1]))
        past = memory.model.course(moments) + np.column_stack([one, other])
        noise = self._settings.noise_px / self._calibration.focal_px
        places = [(float(x), float(y)) for x, y in past]
        memory.bank.rewrite(moments.tolist(), places, noise**2)
        memory.wanted = memory.model.bend  # the reference play stands where the new model is
