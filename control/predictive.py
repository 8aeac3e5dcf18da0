"""The predictive lock: when was it seen, where was the tip then, where will the target be.

1. A hysteresis model of weighted plays runs forward on the measured handles.
2. A frame tells by how much the target lay off the axis at its exposure; added to the bend that the
   model had then, this is where the target was, in bend angles, whatever the latency.
3. Predictors carry it over the latency and the lag of servo and tip.
4. The model's inverse, behind a small reference play, turns the wanted bend into a handle angle.
5. The model begins with almost no hysteresis. Every two seconds weights and latency are identified
   anew, and the target's past is told again with them.
6. Where the handles turn back too often, the law becomes cautious: it turns back only for more.

It needs neither a known latency nor a known width, nothing but what a bench knows.

Reference:
    The parts: control/hysteresis.py, control/prediction.py, control/online_hysteresis.py. Relating
    frames to the robot at their exposure: P. I. Corke, Visual Control of Robots, 1996.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import hypot, isfinite, pi

import numpy as np

from endolock.control import kinematics, online_hysteresis
from endolock.control.hysteresis import Hysteresis, Plays
from endolock.control.kinematics import Pair, SectionGeometry
from endolock.control.prediction import Bank, Harmonic, Mover
from endolock.control.process import BEND_PER_HANDLE, LAG_S
from endolock.hw.api import AXES, Calibration, Command, ConfigError, State, Vector
from endolock.vision import camera_model
from endolock.vision.observation import Observation, Status

RADII = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7)
"""Half-widths of the plays [rad]: loops of up to 0.45 of 180 deg."""
PRIOR = (BEND_PER_HANDLE, *[0.0] * (len(RADII) - 1))
"""Weights at the start: no hysteresis. Over-compensation is what loses targets."""
MIN_TURNS = 2
"""Reversals that must have been seen before the model is believed: the loop shows there alone."""
FAR_RAD = 0.35
"""A target that was so far off the axis is not predicted [rad]: the model must be wrong."""
STILL_RAD_S, SHORT_RAD, SHORT_SHARE = 0.05, 0.02, 0.02
"""Slower handles stand, and a servo stops short by that at most; so much of it is added each tick.
Assumed: 8 mrad are measured on the twin."""
CAUTION = 4.0
"""Factor on the reference play while cautious."""
MIN_FRAMES = 100
"""Fewer identify nothing."""


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
    lead_s: float = LAG_S + 0.030
    """Command to motion [s], >= 0: servo, tip, one and a half control periods."""
    reversal_rad: float = 0.001
    """Smaller changes of the wanted bend do not turn the handles back [rad], >= 0."""
    identify_every_s: float = 2.0
    """[s], > 0; more than the time of any run leaves the model as it begins."""
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
class AxisMemory:
    """Hysteresis of one axis."""

    weights: list[float] = field(default_factory=lambda: list(PRIOR))
    places: list[float] = field(default_factory=lambda: [0.0] * len(RADII))
    """Of the plays [rad]."""
    width_std: float = pi
    """Standard deviation of the width [rad]."""


@dataclass
class PredictiveMemory:
    """What the law remembers."""

    bank: Bank
    axes: tuple[AxisMemory, AxisMemory] = field(
        default_factory=lambda: (AxisMemory(), AxisMemory())
    )
    held: Pair = (0.0, 0.0)
    """The last command [rad]."""
    droop: Pair = (0.0, 0.0)
    """What the servos stop short, added to the command [rad]."""
    wanted: Pair | None = None
    """Bend that is wanted, behind the reference play [rad]."""
    times: list[float] = field(default_factory=list)
    plays: list[list[list[float]]] = field(default_factory=list)
    """Places of all plays at those times, by axis [rad]."""
    seen: list[tuple[float, float, float]] = field(default_factory=list)
    """Exposures as believed [s], and how far the target was off then [rad]."""
    distance_m: float | None = None
    shift_s: float = 0.0
    """Exposures were so much later than believed [s]."""
    shift_std_s: float = 0.0
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
        self.memory = self._fresh((0.0, 0.0))

    @property
    def signals(self) -> dict[str, float]:
        """Wanted bend, widths, latency and their uncertainties, choice of predictor, caution."""
        memory = self.memory
        told: dict[str, float] = {}
        for n, (name, axis) in enumerate(zip(AXES, memory.axes, strict=True)):
            if memory.wanted:
                told[f"target_{name}_rad"] = memory.wanted[n]
            told[f"width_{name}_rad"] = _width(axis.weights)
            told[f"width_std_{name}_rad"] = axis.width_std
        told["latency_off_s"] = -memory.shift_s
        told["latency_std_s"] = memory.shift_std_s
        told["predictor"] = float(memory.bank.chosen)
        told["cautious"] = float(memory.cautious)
        return told

    def reset(self, state: State) -> None:
        """Begin anew where the handles are, the plays centred on them."""
        self.memory = self._fresh((state.position[0], state.position[1]))

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Follow, learn, predict, aim; hold where the target is lost. See `Controller.update`."""
        memory, settings = self.memory, self._settings
        self._follow(state)
        if observation is not None:
            memory.lost = observation.status is Status.LOST
            if observation.status is Status.TRACKING:
                self._take(t, observation)
        if t - memory.identified >= settings.identify_every_s and len(memory.seen) >= MIN_FRAMES:
            memory.identified = t
            self._identify()
        if memory.bank.t is None or memory.lost:
            return Command(position=memory.held)
        self._want(t)
        assert memory.wanted is not None
        handles = [
            min(max(_model(axis).handle_for(want), -pi), pi)
            for axis, want in zip(memory.axes, memory.wanted, strict=True)
        ]
        memory.held = handles[0], handles[1]
        self._count_turns(t)
        droop = []
        for old, goal, place, rate in zip(
            memory.droop, state.target, state.position, state.velocity, strict=True
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
        one, other = (AxisMemory(places=[h] * len(RADII)) for h in handles)
        return PredictiveMemory(bank, axes=(one, other), held=handles, extremes=handles)

    def _follow(self, state: State) -> None:
        """Run the model on the measured handles."""
        memory = self.memory
        if memory.times and state.t <= memory.times[-1]:
            return
        places = []
        for axis, handle in zip(memory.axes, state.position, strict=True):
            _model(axis).follow(handle)
            places.append(list(axis.places))
        memory.rate = hypot(*state.velocity)
        memory.times.append(state.t)
        memory.plays.append(places)
        if memory.times[0] < state.t - online_hysteresis.WINDOW_S - 2.0:
            del memory.times[:50], memory.plays[:50]

    def _take(self, t: float, observation: Observation) -> None:
        """Work out where the target was."""
        memory, settings = self.memory, self._settings
        if isfinite(observation.distance_m):
            memory.distance_m = observation.distance_m
        depth = memory.distance_m or settings.target_distance_m
        exposed = observation.t_capture + memory.shift_s
        bend = self._bend_at(exposed)
        position, rotation = kinematics.forward(self._geometry, bend)
        ray = camera_model.ray(self._calibration, observation.target_px)
        place = kinematics.aim(self._geometry, position + rotation @ (depth * ray))
        off = place[0] - bend[0], place[1] - bend[1]
        memory.seen.append((observation.t_capture, *off))
        memory.off_rad = hypot(*off)
        while memory.seen[0][0] < t - online_hysteresis.WINDOW_S:
            del memory.seen[0]
        noise = settings.noise_px / self._calibration.focal_px
        late = settings.latency_uncertainty_s * memory.rate * BEND_PER_HANDLE
        horizon_s = t - exposed + settings.lead_s
        memory.bank.update(exposed, place, noise**2 + late**2, horizon_s)

    def _bend_at(self, t: float) -> Pair:
        """Bend of the model at a past time [rad]."""
        times, plays = self.memory.times, self.memory.plays
        n = int(np.clip(np.searchsorted(times, t), 1, max(len(times) - 1, 1)))
        before, after = plays[n - 1], plays[min(n, len(plays) - 1)]
        step = times[min(n, len(times) - 1)] - times[n - 1]
        share = min(max((t - times[n - 1]) / step, 0.0), 1.0) if step else 0.0
        one, other = (
            sum(w * (a + share * (b - a)) for w, a, b in zip(axis.weights, p, q, strict=True))
            for axis, p, q in zip(self.memory.axes, before, after, strict=True)
        )
        return one, other

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
        one, other = (min(max(w, a - reach), a + reach) for w, a in zip(before, aim, strict=True))
        memory.wanted = one, other

    def _identify(self) -> None:
        """Identify weights and latency, and tell the target's past again with them."""
        memory, settings = self.memory, self._settings
        seen = np.array(memory.seen)
        seen = seen[seen[:, 0] > memory.times[0] + 0.2]
        if len(seen) < MIN_FRAMES:
            return
        times, plays = np.array(memory.times), np.array(memory.plays)
        found = online_hysteresis.identify(
            seen[:, 0], seen[:, 1:], times, plays, np.array(PRIOR), np.array(RADII), memory.shift_s
        )
        if found is None:
            return
        memory.known = memory.turned >= MIN_TURNS
        memory.shift_s += 0.3 * (found.shift_s - memory.shift_s)
        memory.shift_std_s = found.shift_std_s
        for axis, weights, std in zip(memory.axes, found.weights, found.width_std, strict=True):
            if weights is not None:
                old = np.array(axis.weights)
                axis.weights = (old + settings.damping * (weights - old)).tolist()
                axis.width_std = std
        moments = seen[:, 0] + memory.shift_s
        past: list[Vector] = []
        for n, axis in enumerate(memory.axes):
            bend = np.interp(moments, times, plays[:, n] @ np.array(axis.weights))
            past.append(bend + seen[:, 1 + n])
        noise = settings.noise_px / self._calibration.focal_px
        places = list(zip(past[0].tolist(), past[1].tolist(), strict=True))
        memory.bank.rewrite(moments.tolist(), places, noise**2)
        one, other = (_model(axis).bend_rad for axis in memory.axes)
        memory.wanted = one, other  # the reference play stands where the new model is


def _model(axis: AxisMemory) -> Hysteresis:
    return Hysteresis(Plays(radii=RADII, weights=tuple(axis.weights)), axis.places)


def _width(weights: list[float]) -> float:
    """Mean full width of a loop [rad]."""
    return 2 * sum(w * r for w, r in zip(weights, RADII, strict=True)) / max(sum(weights), 1e-6)
