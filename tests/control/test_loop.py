"""The loop: when it ticks, what it passes on, and how it stops."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import pairwise
from math import inf, nan
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endolock.control import loop
from endolock.control.laws.pi import PI
from endolock.hw.api import Command, ConfigError, DeviceFault, Frame, HardwareError, Mode, State
from endolock.twin.hil.hil_rig import HilRig
from endolock.twin.rig import TwinRig
from endolock.twin.surrogate import SurrogateRig
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.motion import Circle
from endolock.twin.world.scenario import Scenario
from endolock.twin.world.scenario_sections import CameraSettings
from endolock.vision.observation import Observation, Status, Turn
from endolock.vision.truth_eyes import TruthEyes

ASIDE = Scenario(name="aside", motion=(Circle(kind="circle", radius_m=0.03, period_s=1e9),))
"""The board stands 30 mm to the right, 65 px, for good."""


class LateClock:
    """A clock that oversleeps, by one delay after another, and then no more."""

    realtime = True

    def __init__(self, *delays_s: float, start_s: float = 0.0, timestep_s: float = 0.0) -> None:
        self.timestep_s = timestep_s
        self._t, self._delays = start_s, list(delays_s)

    def now(self) -> float:
        """Present time [s]."""
        return self._t

    def sleep_until(self, t: float) -> float:
        """Wake up too late."""
        self._t = max(self._t, t) + (self._delays.pop(0) if self._delays else 0.0)
        return self._t


class Constant:
    """A controller that always returns the same command, and keeps its inputs."""

    def __init__(self, *position: float) -> None:
        self.resets: list[State] = []
        self.inputs: list[tuple[float, State, Observation | None]] = []
        self.given: list[Command] = []
        self._position = position

    def reset(self, state: State) -> None:
        """Take note."""
        self.resets.append(state)

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Take note, and give the command."""
        self.inputs.append((t, state, observation))
        self.given.append(Command(position=self._position))
        return self.given[-1]


class Unlimited(Constant):
    """Gives commands that are valid for a time too long for a float."""

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Take note, and give the command."""
        return replace(super().update(t, state, observation), valid_for=10**400)


class Failing:
    """Leaves the program in the reset, or fails later on."""

    def __init__(self, resets: int) -> None:
        self._resets = resets

    def reset(self, state: State) -> None:
        """Start, or leave."""
        if not self._resets:
            sys.exit(0)

    def update(self, t: float) -> None:
        """Take too few arguments."""


class Watched:
    """Eyes that keep which frames they were shown."""

    def __init__(self, rig: TwinRig) -> None:
        self.shown: list[int] = []
        self._eyes = TruthEyes(rig.truth)

    def __call__(self, frame: Frame) -> Observation:
        """Look, and take note."""
        self.shown.append(frame.seq)
        return self._eyes(frame)


class Rows:
    """A recorder in memory."""

    def __init__(self) -> None:
        self.ticks: list[loop.Tick] = []
        self.frames: list[loop.Seen] = []

    def tick(self, tick: loop.Tick) -> None:
        """Keep it."""
        self.ticks.append(tick)

    def seen(self, seen: loop.Seen) -> None:
        """Keep it."""
        self.frames.append(seen)


def test_ticks_have_absolute_deadlines() -> None:
    clock = LateClock(*[0.004, 0.001, 0.006] * 10, start_s=7.0)  # jitter, less than a period
    got = list(loop.ticks(clock, 0.02, 7.5))
    assert len(got) == 26  # 0.5 s, both ends included
    for n, (t, skipped) in enumerate(got):
        assert skipped == 0
        assert 7.0 + n * 0.02 - 1e-9 <= t <= 7.0 + n * 0.02 + 0.006 + 1e-9  # rounding; no drift


def test_a_late_tick_is_skipped_and_counted() -> None:
    clock = LateClock(0.0, 0.05)  # due at 0.02, awake at 0.07
    got = list(loop.ticks(clock, 0.02, 0.12))
    assert [t for t, _ in got] == pytest.approx([0.0, 0.07, 0.08, 0.10, 0.12])
    assert [skipped for _, skipped in got] == [0, 2, 0, 0, 0]


@settings(deadline=None)
@given(st.lists(st.sampled_from([0.0, 0.001, 0.019, 0.02, 0.021, 0.1, 0.33]), max_size=40))
def test_ticks_never_burst(delays: list[float]) -> None:
    period_s, slot = 0.02, -1
    for t, skipped in loop.ticks(LateClock(*delays), period_s, 2.0):
        slot += 1 + skipped
        # One tick to a slot, and it lies within it; 1e-6 of a period is for rounding.
        assert slot * period_s - 1e-7 <= t < (slot + 1) * period_s + 1e-7


@pytest.mark.parametrize(
    ("period_s", "timestep_s", "message"),
    [
        (
            0.033,
            0.002,
            "control period 0.033 s is not a multiple of the physics timestep 0.002 s; "
            "use 0.032 or 0.034",
        ),
        (
            0.001,
            0.002,
            "control period 0.001 s is not a multiple of the physics timestep 0.002 s; use 0.002",
        ),
        (0.0, 0.002, "control period 0 s; use more than 0, such as 0.02"),
        (-0.02, 0.0, "control period -0.02 s; use more than 0, such as 0.02"),
        (nan, 0.0, "control period nan s; use more than 0, such as 0.02"),
    ],
)
def test_a_period_off_the_grid_is_refused(period_s: float, timestep_s: float, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        loop.check_period(LateClock(timestep_s=timestep_s), period_s)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("period_s", "timestep_s"), [(0.02, 0.002), (0.03, 0.01), (0.3, 0.1), (0.033, 0.0)]
)
def test_a_period_on_the_grid_is_accepted(period_s: float, timestep_s: float) -> None:
    loop.check_period(LateClock(timestep_s=timestep_s), period_s)


@pytest.mark.parametrize("duration_s", [0.0, -1.0, nan, -inf])
def test_a_run_needs_a_positive_duration(duration_s: float) -> None:
    with TwinRig("rest", pictures=False) as rig:
        with pytest.raises(ConfigError, match=rf"^duration {duration_s:g} s; use more than 0$"):
            loop.run(rig, TruthEyes(rig.truth), Constant(0, 0), duration_s=duration_s)
        assert rig.actuators.mode is Mode.DISABLED  # refused before torque came on


def test_rows_hold_matching_commands_and_states() -> None:
    law, rows = Constant(0.2, -0.1), Rows()
    with TwinRig("rest", pictures=False) as rig:
        result = loop.run(rig, TruthEyes(rig.truth), law, duration_s=1.0, recorder=rows)
        assert rig.actuators.mode is Mode.HOLDING
    ticks = result.ticks
    assert not result.interrupted
    assert rows.ticks == ticks
    assert len(rows.frames) == len(result.seen)
    assert len(law.resets) == 1
    # A command is sent one tick after it was made.
    assert [tick.command for tick in ticks] == [None, *law.given[:-1]]
    assert [(tick.t, tick.state) for tick in ticks] == [(t, state) for t, state, _ in law.inputs]
    assert [tick.t for tick in ticks] == pytest.approx([n * 0.02 for n in range(51)])
    assert all(tick.truth and tick.truth.t == tick.t == tick.state.t for tick in ticks)


def test_eyes_get_every_frame_once() -> None:
    law = Constant(0, 0)
    with TwinRig("rest", pictures=False) as rig:
        eyes = Watched(rig)
        result = loop.run(rig, eyes, law, duration_s=2.0)
    # 25 Hz, 0.4 s late: after 2 s, the exposures from 0 to 1.6 s have come.
    assert eyes.shown == list(range(41))
    assert [seen.frame.seq for seen in result.seen] == eyes.shown
    observations = [observation for _, _, observation in law.inputs if observation]
    assert observations == [seen.observation for seen in result.seen]
    for seen in result.seen:
        assert seen.truth
        assert seen.truth.t == pytest.approx(seen.frame.t_capture)  # no jitter: belief is true
    first = result.seen[0].frame.t_available
    for tick in result.ticks:
        seeing = tick.t >= first - 1e-9  # rounding of the delivery time
        assert tick.status is (Status.TRACKING if seeing else Status.SEARCHING)


def test_frames_that_never_arrive_are_not_waited_for() -> None:
    scenario = Scenario(name="lossy", camera=CameraSettings(drop_fraction=0.5))
    with TwinRig(scenario, pictures=False) as rig:
        eyes = Watched(rig)
        result = loop.run(rig, eyes, Constant(0, 0), duration_s=2.0)
    assert 0 < len(eyes.shown) < 41
    assert eyes.shown == sorted(set(eyes.shown))
    assert len(eyes.shown) + sum(s.frame.dropped for s in result.seen) == eyes.shown[-1] + 1


def test_an_interrupt_ends_the_run_safely() -> None:
    def progress(t: float) -> None:
        if t > 0.5:
            raise KeyboardInterrupt

    with TwinRig("rest", pictures=False) as rig:
        eyes = TruthEyes(rig.truth)
        result = loop.run(rig, eyes, Constant(0.5, 0.5), duration_s=9.0, progress=progress)
        assert result.interrupted
        assert result.ticks[-1].t == pytest.approx(0.52)
        assert rig.actuators.mode is Mode.HOLDING
        goal = rig.actuators.exchange(None).goal
        for t in (0.8, 1.1, 1.4):  # the motors' own watchdog wants to hear of somebody
            rig.clock.sleep_until(t)
            assert rig.actuators.exchange(None).goal == goal


def test_a_controller_that_returns_nan_is_stopped() -> None:
    rows = Rows()
    with TwinRig("rest", pictures=False) as rig:
        eyes, law = TruthEyes(rig.truth), Constant(0.1, nan)
        with pytest.raises(ConfigError, match=r"^Constant: update returned .*0\.1, nan\)"):
            loop.run(rig, eyes, law, duration_s=1.0, recorder=rows)
        assert rig.actuators.mode is Mode.HOLDING
        assert len(rows.ticks) == 1  # the command was refused when it was returned


def test_a_fault_ends_the_run_with_its_rows_kept() -> None:
    rows = Rows()
    weak = Instrument(handle_torque_nm=0.001)  # cannot turn the handle against its wires
    with TwinRig("rest", instrument=weak, pictures=False) as rig:
        eyes, law = TruthEyes(rig.truth), Constant(2.0, 0.0)
        with pytest.raises(DeviceFault, match=r"^handle up_down is \+"):
            loop.run(rig, eyes, law, duration_s=5.0, recorder=rows)
        assert rig.actuators.mode is Mode.FAULT
        assert rows.ticks[-1].state.mode is Mode.ENABLED
        assert rows.ticks[-1].t == pytest.approx(rig.clock.now() - loop.PERIOD_S)


def test_pi_brings_the_target_to_the_centre() -> None:
    with TwinRig(ASIDE, pictures=False) as rig:
        law = PI(rig.camera.calibration)
        result = loop.run(rig, TruthEyes(rig.truth), law, duration_s=20.0)
    error_deg = [tick.truth.error_deg for tick in result.ticks if tick.truth]
    assert error_deg[0] == pytest.approx(14.0, abs=0.1)  # atan(30 mm / 120 mm)
    # It closes with about 1 / ki = 4 s; a tenth leaves room for friction and the shape of the bend.
    assert max(error_deg[-100:]) < 1.4


def _gone(rig: TwinRig, start_s: float, end_s: float) -> None:
    """Let the video chain of a rig deliver nothing new for a while."""
    last: list[Frame] = []
    honest = rig.camera.latest

    def dies() -> Frame | None:
        frame = honest()
        if frame is not None and not start_s < frame.t_available < end_s:
            last.append(frame)
        return last[-1] if last else None

    rig.camera.latest = dies  # type: ignore[method-assign]  # the chain is on trial


def test_without_pictures_the_handles_hold_and_the_lock_is_lost() -> None:
    """A video chain that dies must not leave a law pushing at what it saw last."""
    with TwinRig("rest", pictures=False) as rig:
        _gone(rig, 1.0, 5.0)
        law = Winding()
        result = loop.run(rig, TruthEyes(rig.truth), law, duration_s=6.0)
    dead = [t for t in result.ticks if 1.0 + loop.BLIND_S + 0.05 < t.t < 5.0]
    assert {t.status for t in dead} == {Status.LOST}
    assert {t.state.mode for t in dead} == {Mode.HOLDING}
    assert len({t.state.goal for t in dead}) == 1
    assert result.ticks[-1].status is Status.TRACKING
    assert law.resets == 2  # when it began, and when pictures came again


def test_a_law_that_can_resume_is_not_reset_when_pictures_come_again() -> None:
    resumed: list[State] = []

    class Lasting(Winding):
        def resume(self, state: State) -> None:
            """Go on from where the handle is held."""
            resumed.append(state)
            self.goal = state.goal[0]

    with TwinRig("rest", pictures=False) as rig:
        _gone(rig, 1.0, 5.0)
        law = Lasting()
        result = loop.run(rig, TruthEyes(rig.truth), law, duration_s=6.0)
    assert law.resets == 1
    assert [state.mode for state in resumed] == [Mode.HOLDING]
    held = next(t for t in result.ticks if t.t == pytest.approx(resumed[0].t))
    assert resumed[0].goal == held.state.goal
    again = [t.state.goal[0] for t in result.ticks if t.t > resumed[0].t]
    # goes on by 0.5 mrad a tick, in counts of 1.5 mrad
    assert max(abs(b - a) for a, b in pairwise([held.state.goal[0], *again])) < 0.0016


def test_the_end_of_the_video_ends_the_run_with_the_handles_held() -> None:
    rows = Rows()
    with TwinRig("rest", pictures=False) as rig:
        honest = rig.camera.latest

        def ends() -> Frame | None:
            if rig.clock.now() > 1.0:
                raise HardwareError("the video ended: /dev/video0", t=rig.clock.now())
            return honest()

        rig.camera.latest = ends  # type: ignore[method-assign]  # the chain is on trial
        with pytest.raises(HardwareError, match="the video ended"):
            loop.run(rig, TruthEyes(rig.truth), Winding(), duration_s=6.0, recorder=rows)
        assert rig.actuators.mode is Mode.HOLDING
        goal = rows.ticks[-1].state.goal
        rig.clock.sleep_until(1.1)
        assert rig.actuators.exchange(None).goal == pytest.approx(goal, abs=0.002)  # a count
    assert rows.ticks[-1].t == pytest.approx(1.0)


class Winding:
    """A law that turns a handle on and on, seeing or not."""

    def __init__(self) -> None:
        self.resets, self.goal = 0, 0.0

    def reset(self, state: State) -> None:
        """Start where the handle is."""
        self.resets += 1
        self.goal = state.position[0]

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Go on."""
        self.goal += 0.0005
        return Command(position=(self.goal, 0.0))


class Reused:
    """Keeps one array, one list or one command, and changes it after it was returned."""

    def __init__(self, kind: str, steps: list[tuple[float, float]]) -> None:
        self.meant: list[tuple[float, ...]] = []
        self.signals = {"n": 0.0}
        self._kind, self._steps = kind, steps

    def reset(self, state: State) -> None:
        """Start at the handles."""
        self._array = np.array(state.position)
        self._list = list(state.position)
        self._command = Command(position=self._array)  # type: ignore[arg-type]  # a user may

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Change in place what was returned before, and return it again."""
        step = self._steps[len(self.meant) % len(self._steps)]
        self._array += step
        self._list[:] = self._array.tolist()
        self.meant.append(tuple(self._list))
        self.signals["n"] = float(len(self.meant))
        if self._kind == "list":
            return Command(position=self._list)
        if self._kind == "view":
            return Command(position=self._array[:])  # type: ignore[arg-type]
        if self._kind == "field":
            object.__setattr__(self._command, "position", self._list)
        return self._command


steps = st.floats(-0.02, 0.02).map(lambda x: round(x, 6))


@settings(max_examples=12)
@given(
    st.sampled_from(["list", "view", "array", "field"]),
    st.lists(st.tuples(steps, steps), min_size=1, max_size=5),
)
def test_each_tick_gets_the_command_that_was_meant_for_it(
    kind: str, moves: list[tuple[float, float]]
) -> None:
    check_reused(SurrogateRig("rest"), kind, moves)


@pytest.mark.parametrize("make", [TwinRig, HilRig])
def test_so_it_is_on_the_twin_and_on_the_emulated_bus(make: type[TwinRig | HilRig]) -> None:
    check_reused(make("rest", pictures=False), "array", [(0.01, -0.02), (-0.03, 0.0)])


def check_reused(rig: SurrogateRig | TwinRig | HilRig, kind: str, moves: Any) -> None:
    """Run a law that changes its commands afterwards, and compare what was sent and recorded."""
    law, rows = Reused(kind, moves), Rows()
    with rig:
        result = loop.run(rig, TruthEyes(rig.truth), law, duration_s=0.2, recorder=rows)
    sent = [tick.command.position for tick in result.ticks[1:] if tick.command]
    assert sent == law.meant[:-1]
    assert [tick.signals["n"] for tick in result.ticks[1:]] == list(range(1, len(sent) + 1))
    assert rows.ticks == result.ticks
    for tick in result.ticks[1:]:  # moves are slower than the handles may be, so none is clipped
        assert tick.command
        # half an encoder step of 0.088 deg, and rounding
        assert tick.state.goal == pytest.approx(tick.command.position, abs=0.00077 + 1e-9)


class Forgetful:
    """Eyes that keep one array and one list, and change them with each frame."""

    def __init__(self) -> None:
        self.pixel, self.corners, self.turned = np.zeros(2), [[0.0, 0.0]], np.zeros(3)

    def __call__(self, frame: Frame) -> Observation:
        """See the target at the number of the frame."""
        self.pixel[:] = self.corners[0][0] = self.turned[:] = frame.seq
        return Observation(
            t_capture=frame.t_capture,
            seq=frame.seq,
            status=Status.TRACKING,
            target_px=self.pixel,  # type: ignore[arg-type]  # a user may
            corners_px=self.corners,  # type: ignore[arg-type]
            turn=Turn(since_s=0.0, vector=self.turned, covariance=np.eye(3)),  # type: ignore[arg-type]
        )


def test_each_frame_keeps_the_observation_that_was_made_of_it() -> None:
    with SurrogateRig("rest") as rig:
        result = loop.run(rig, Forgetful(), Constant(0, 0), duration_s=1.0)
    assert len(result.seen) == 16  # 25 Hz, 0.4 s late
    for seen in result.seen:
        n = seen.frame.seq
        assert seen.observation.target_px == (n, n)
        assert seen.observation.corners_px == ((n, 0.0),)
        assert seen.observation.turn == Turn(since_s=0.0, vector=(n, n, n), covariance=UNITY)


UNITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def test_the_loop_passes_on_how_the_camera_turned() -> None:
    nothing = (0.0, 0.0, 0.0)
    turn = Turn(since_s=-0.04, vector=(0.1, 0.2, 0.3), covariance=(nothing, nothing, nothing))
    law = Constant(0, 0)
    with SurrogateRig("rest") as rig:
        result = loop.run(rig, _eyes(turn=turn), law, duration_s=0.5)
    assert [seen.observation.turn for seen in result.seen] == [turn] * len(result.seen)
    assert [seen.turn for _, _, seen in law.inputs if seen] == [turn] * len(result.seen)


def _eyes(**changes: Any) -> Any:
    plain: dict[str, Any] = {"t_capture": 0.0, "seq": 0, "status": Status.SEARCHING}
    return lambda frame: Observation(**plain | changes)


@pytest.mark.parametrize(
    ("eyes", "why"),
    [
        (lambda frame: None, "returned NoneType for frame 0; return an endolock.Observation"),
        (lambda frame: 1 / 0, "looking at a frame failed: ZeroDivisionError: division by zero"),
        (lambda frame: sys.exit(0), "looking at a frame failed: SystemExit: 0"),
        (_eyes(target_px=None), "target_px None in the observation of frame 0"),
        (_eyes(target_px=(1.0,)), r"target_px \(1.0,\) in the observation"),
        (_eyes(status="seen"), "status 'seen' in the observation"),
        (_eyes(status=Status.TRACKING), r"target_px \(nan, nan\) in the observation"),
        (_eyes(corners_px=[1.0]), r"corners_px \[1.0\] in the observation"),
        (_eyes(covariance="abc"), "covariance 'abc' in the observation"),
        (_eyes(turn=(0.1, 0.2, 0.3)), r"turn \(0.1, 0.2, 0.3\) in the observation"),
        (
            _eyes(turn=Turn(since_s=0.0, vector=(0.0, nan, 0.0), covariance=UNITY)),
            r"turn Turn\(.*nan.* in the observation",
        ),
        (3, "int cannot be called with a frame"),
    ],
)
def test_eyes_that_return_rubbish_end_the_run_in_one_line(eyes: Any, why: str) -> None:
    with SurrogateRig("rest") as rig:
        with pytest.raises(ConfigError, match=why) as caught:
            loop.run(rig, eyes, Constant(0, 0), duration_s=0.5)
        assert rig.actuators.mode in (Mode.HOLDING, Mode.DISABLED)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("law", "why"),
    [
        (object(), r"^object: object, which has no reset\(\)"),
        (Constant, r"the class Constant, which has no reset\(\)"),
        (Constant(0.0), r"Constant: update returned the position \(0.0,\) at 0.00 s"),
        (Constant("a", "b"), r"update returned the position \('a', 'b'\)"),  # type: ignore[arg-type]
        (Unlimited(0.0, 0.0), r"Unlimited: update returned a command valid for 1000"),
        (Failing(1), r"Failing: update failed: TypeError: .* \(line \d+\)"),
        (Failing(0), r"Failing: reset failed: SystemExit: 0 \(line \d+\)"),
    ],
)
def test_a_controller_object_is_checked_in_the_loop_too(law: Any, why: str) -> None:
    with SurrogateRig("rest") as rig:
        with pytest.raises(ConfigError, match=why):
            loop.run(rig, TruthEyes(rig.truth), law, duration_s=0.5)
        assert rig.actuators.mode in (Mode.HOLDING, Mode.DISABLED)
