"""Runs a rig, its eyes and a controller together: turns frames into commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import inf
from typing import Protocol

from endolock.control.user_controller import UserController
from endolock.control.user_eyes import UserEyes
from endolock.hw.api import PERIOD_S as PERIOD_S
from endolock.hw.api import Clock, Command, ConfigError, Frame, Pose, Rig, State, TruthSample
from endolock.hw.frozen import Frozen
from endolock.vision.observation import BLIND_S as BLIND_S
from endolock.vision.observation import Eyes, Observation, Status


class Controller(Protocol):
    """Drives the handles from observations and handle states; owns its state, has no clock.

    It may have `signals`, a mapping of names to numbers: internal values to be recorded. It may
    have `resume(state)`, called instead of `reset` when frames come again after more than
    `BLIND_S`, with the handles held meanwhile: what it knows of the transmission still holds, and
    where the target was is out of date.
    """

    def reset(self, state: State) -> None:
        """Restart from the present handle state.

        Called at the start of each run, and, without `resume`, when frames come again. To hold the
        handles, command `state.goal`: a loaded handle stands short of its goal, and a command of
        `state.position` would let it yield.
        """

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Compute the command of one control period.

        Args:
            t: time of the tick [s].
            state: handle state, just measured.
            observation: made from the newest frame; None if there is no new frame.

        Returns:
            Goals of the handles; sent with the exchange of the next tick.
        """


@dataclass(frozen=True, kw_only=True)
class Tick(Frozen):
    """One control period as it happened."""

    t: float
    """When it began [s]."""
    skipped: int
    """Periods that were missed before this one."""
    command: Command | None
    """The command sent; None in the first tick."""
    state: State
    status: Status
    """State of the lock, from the newest frame."""
    tracked: Pose | None
    """The newest pose of the tip from a tracker; None without one."""
    truth: TruthSample | None
    """The truth now; None on hardware."""
    signals: Mapping[str, float] = field(default_factory=dict)
    """Internal values of the controller, by name, when it computed the command that was sent."""


@dataclass(frozen=True, kw_only=True)
class Seen(Frozen):
    """One delivered frame and its observation."""

    frame: Frame
    observation: Observation
    overview: Frame | None
    """The fixed camera's newest picture when this frame was delivered, if not seen before."""
    truth: TruthSample | None
    """The truth at the exposure; None on hardware."""

    def without_pictures(self) -> Seen:
        """Return a copy without pictures, to save memory."""
        return replace(self, frame=replace(self.frame, image=None), overview=None)


class Recorder(Protocol):
    """Stores the rows of a run."""

    def tick(self, tick: Tick) -> None:
        """Store one control period."""

    def seen(self, seen: Seen) -> None:
        """Store one frame."""


class Recorders:
    """Several recorders as one; the first gets each row first.

    Args:
        recorders: what stores the rows.
    """

    def __init__(self, *recorders: Recorder) -> None:
        self._recorders = recorders

    def tick(self, tick: Tick) -> None:
        """Store one control period in each."""
        for recorder in self._recorders:
            recorder.tick(tick)

    def seen(self, seen: Seen) -> None:
        """Store one frame in each."""
        for recorder in self._recorders:
            recorder.seen(seen)


@dataclass
class Run:
    """A run in memory, without pictures, which only the recorder gets."""

    ticks: list[Tick] = field(default_factory=list)
    seen: list[Seen] = field(default_factory=list)
    interrupted: bool = False


def ticks(clock: Clock, period_s: float, until_s: float) -> Iterator[tuple[float, int]]:
    """Yield (time, periods skipped) at absolute deadlines; a late tick is skipped, never caught up.

    Args:
        clock: sleeps until each deadline.
        period_s: control period [s].
        until_s: deadline of the last tick [s], counted like `clock.now()`.
    """
    start = clock.now()
    n = 0
    while start + n * period_s <= until_s + 1e-9:
        t = clock.sleep_until(start + n * period_s)
        if t >= until_s + period_s:
            return
        late = int((t - start) / period_s + 1e-6) - n
        yield t, late
        n += late + 1


def check_period(clock: Clock, period_s: float) -> None:
    """Check that ticks fall on the clock's grid.

    Raises:
        ConfigError: they do not.
    """
    if not 0 < period_s < inf:
        raise ConfigError(f"control period {period_s:g} s", f"use more than 0, such as {PERIOD_S}")
    if not clock.timestep_s:
        return
    steps = period_s / clock.timestep_s
    if abs(steps - round(steps)) > 1e-6:
        below = int(steps)
        near = [f"{n * clock.timestep_s:g}" for n in (below, below + 1) if n]
        raise ConfigError(
            f"control period {period_s:g} s is not a multiple of the physics timestep "
            f"{clock.timestep_s:g} s",
            f"use {' or '.join(near)}",
        )


def run(
    rig: Rig,
    eyes: Eyes,
    controller: Controller,
    *,
    duration_s: float,
    period_s: float = PERIOD_S,
    recorder: Recorder | None = None,
    keep: bool = True,
    progress: Callable[[float], None] | None = None,
) -> Run:
    """Run a controller on a rig; the handles hold when it returns or raises.

    To continue with the rig, do so before the motors' own watchdog trips, or clear its fault. If
    frames stop coming, the handles hold and the lock is lost, until one comes again; the
    controller then resumes, see `Controller`.

    Args:
        rig: clock, handles and camera; connected here if it is not.
        eyes: turns frames into observations.
        controller: computes the commands.
        duration_s: length of the run [s], > 0.
        period_s: control period [s], a multiple of the clock's grid.
        recorder: stores every row at once, pictures included.
        keep: whether the result holds all ticks and frames, about 4 kB per tick; a long run is
            better left to a recorder, such as `metrics.Scorer`.
        progress: called with the time after each tick [s].

    Returns:
        All ticks and frames, without pictures, or none of them without `keep`; `interrupted` if
        Ctrl-C ended it early.

    Raises:
        ConfigError: duration, period, eyes or controller cannot be used, or eyes or controller
            failed.
        HardwareError: the handles stopped, or the video ended; the recorder has all rows up to
            there.
    """
    if not duration_s > 0:
        raise ConfigError(f"duration {duration_s:g} s", "use more than 0")
    check_period(rig.clock, period_s)
    law = controller if isinstance(controller, UserController) else UserController(controller)
    look = UserEyes(eyes)
    result = Run()
    actuators, tracker, truth = rig.actuators, rig.tracker, rig.truth
    actuators.connect()
    mode = actuators.mode
    state = actuators.exchange(None) if mode.driven else actuators.enable()
    command: Command | None = None
    start = rig.clock.now()
    status, shown = Status.SEARCHING, -1
    seen_at, blind = start, False
    try:
        law.reset(state)
        before = rig.camera.latest()  # ignore frames from before the run
        stale = before is not None and before.t_available < start
        newest = before.seq if before and stale else -1
        for t, skipped in ticks(rig.clock, period_s, start + duration_s):
            blind = t - seen_at > BLIND_S
            if blind:
                command, status = None, Status.LOST
                actuators.hold()
            state = actuators.exchange(command)
            observation = None
            frame = rig.camera.latest()
            if frame is not None and frame.seq > newest:
                newest, seen_at = frame.seq, t
                observation = look(frame)
                status = observation.status
                overview = rig.overview.latest() if rig.overview else None
                if overview is not None and overview.seq == shown:
                    overview = None
                shown = overview.seq if overview else shown
                seen = Seen(
                    frame=frame,
                    observation=observation,
                    overview=overview,
                    truth=truth.at_exposure(frame.seq) if truth else None,
                )
                if recorder:
                    recorder.seen(seen)
                if keep:
                    result.seen.append(seen.without_pictures())
            tick = Tick(
                t=t,
                skipped=skipped,
                command=command,
                state=state,
                status=status,
                tracked=tracker.latest() if tracker else None,
                truth=truth.now() if truth else None,
                signals=law.signals if command else {},
            )
            if recorder:
                recorder.tick(tick)
            if keep:
                result.ticks.append(tick)
            if blind and observation is not None:
                law.resume(state)
            if not blind or observation is not None:
                command = law.update(t, state, observation)
            if progress:
                progress(t)
    except KeyboardInterrupt:
        result.interrupted = True
    finally:
        actuators.hold()
    return result
