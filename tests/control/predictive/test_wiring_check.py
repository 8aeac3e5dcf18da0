"""Wrongly connected handles are found at their first motion, and right ones never accused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import pi, radians
from typing import Any

import numpy as np
import pytest

from endolock.control import loop
from endolock.control.laws.ik_sync import SynchronousIK
from endolock.control.predictive.wiring_check import WiringCheck
from endolock.control.transmission.kinematics import Pair, SectionGeometry
from endolock.control.transmission.plays import ONE_PLAY
from endolock.hw.api import Calibration, Command, ConfigError, State
from endolock.hw.errors import WiringError
from endolock.twin.exact_eyes import eyes_of_truth
from endolock.twin.surrogate import SurrogateRig
from endolock.twin.world import scenario
from endolock.twin.world.instrument import Instrument
from endolock.vision import camera_model
from endolock.vision.observation import Observation, Status

SAME, EXCHANGED = np.eye(2), np.array([[0.0, 1.0], [1.0, 0.0]])
UP_DOWN, LEFT_RIGHT = np.diag([-1.0, 1.0]), np.diag([1.0, -1.0])
WRONG = {
    "up_down reversed": UP_DOWN,
    "left_right reversed": LEFT_RIGHT,
    "both reversed": -SAME,
    "exchanged": EXCHANGED,
    "exchanged, both reversed": -EXCHANGED,
    "exchanged, up_down reversed": EXCHANGED @ UP_DOWN,
    "exchanged, left_right reversed": EXCHANGED @ LEFT_RIGHT,
}

NOISY = {"camera.truth_noise_px": 3.0, "camera.latency_s": 0.5, "camera.nominal_latency_s": 0.4}


class Crossed:
    """Handles that are connected otherwise than believed: inner = wiring @ outer."""

    def __init__(self, inner: Any, wiring: np.ndarray) -> None:
        self._inner, self._wiring = inner, wiring

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def enable(self) -> State:
        """Enable the handles."""
        return self._outer(self._inner.enable())

    def exchange(self, command: Command | None) -> State:
        """Exchange a command and a state, both as believed."""
        if command is not None:
            inner = tuple((self._wiring @ command.position).tolist())
            command = replace(command, position=inner)
        return self._outer(self._inner.exchange(command))

    def _outer(self, state: State) -> State:
        back = self._wiring.T
        position, velocity, goal = (
            tuple((back @ values).tolist())
            for values in (state.position, state.velocity, state.goal)
        )
        return replace(state, position=position, velocity=velocity, goal=goal)


class CrossedRig:
    """A rig with crossed handles."""

    def __init__(self, rig: Any, wiring: np.ndarray) -> None:
        self._rig, self.actuators = rig, Crossed(rig.actuators, wiring)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._rig, name)


class Watched:
    """A simple law whose handles are checked; it knows the bend by summing the small turns."""

    def __init__(self, calibration: Calibration, background: bool) -> None:
        self._calibration, self._background = calibration, background
        self._law = SynchronousIK(calibration)
        self.check = WiringCheck(SectionGeometry())

    def reset(self, state: State) -> None:
        """Restart."""
        self._law.reset(state)

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Check the handles, then follow the law."""
        self.check.follow(t, (state.position[0], state.position[1]))
        if observation is not None:
            target, variance = None, 0.0
            if observation.status is Status.TRACKING:
                ray = camera_model.ray(self._calibration, observation.target_px)
                target = observation.distance_m * ray
                variance = observation.covariance[0] / self._calibration.focal_px**2
            turn = observation.turn if self._background else None
            turned: Pair | None = turn.vector[:2] if turn else None
            walk = turn.covariance[0][0] if turn else 0.0
            self.check.look(observation.t_capture, target, turned, (variance, walk))
        return self._law.update(t, state, observation)


def _run(
    path: str,
    wiring: np.ndarray,
    *,
    duration_s: float,
    background: bool = True,
    instrument: Instrument | None = None,
    changes: Mapping[str, float] | None = None,
) -> tuple[float | None, WiringError | None, Watched]:
    """Run; return when a wrong handle had turned the tip by 0.3 rad, and the error."""
    given = {"duration_s": duration_s, "camera.truth_noise_px": 0.3, **(changes or {})}
    task = scenario.load(path, given)
    with SurrogateRig(task, transmission=ONE_PLAY, instrument=instrument) as rig:
        law = Watched(rig.camera.calibration, background)
        wrong = np.abs(wiring - SAME).sum(1) > 0  # inner axes that are not what they seem
        moved: list[float] = []

        class Clock:
            def tick(self, tick: loop.Tick) -> None:
                assert tick.truth
                if np.abs(tick.truth.plant.bend_rad)[wrong].max(initial=0.0) > 0.3:
                    moved.append(tick.t)

            def seen(self, seen: loop.Seen) -> None:
                pass

        error = None
        try:
            crossed: Any = CrossedRig(rig, wiring)
            eyes = eyes_of_truth(rig.truth, task, 0)
            loop.run(crossed, eyes, law, duration_s=duration_s, recorder=Clock(), keep=False)
        except WiringError as caught:
            error = caught
            moved.append(rig.clock.now())
            ended = rig.clock.now()
            assert ended - moved[0] <= 2.0
        return (moved[0] if moved else None), error, law


@pytest.mark.parametrize("name", WRONG)
def test_with_a_background_wrong_handles_are_named_within_two_seconds_of_motion(name: str) -> None:
    moved, error, _ = _run("circle", WRONG[name], duration_s=8.0)
    assert moved is not None
    assert isinstance(error, ConfigError)  # so commands end with 2
    assert "\n" not in str(error)
    if name.startswith("exchanged"):
        assert f"handle {error.axis} turns the tip about the axis" in str(error)
        assert "exchange the ids of" in error.next_step
    else:
        assert f"handle {error.axis} turns the tip the wrong way" in str(error)
        assert f"direction in [handle.{error.axis}] of bench.toml" in error.next_step
        assert name.startswith((error.axis, "both"))


@pytest.mark.parametrize("background", [True, False])
@pytest.mark.parametrize("path", ["straight", "random", "breathing"])
def test_right_handles_are_not_accused(path: str, background: bool) -> None:
    _, error, law = _run(
        path,
        SAME,
        duration_s=14.0,
        background=background,
        changes=NOISY,
    )
    assert error is None
    if path == "straight" and background:  # 30 s are not needed: it turns the tip by 0.6 rad
        assert not law.check.open[1]


def _handles_and_frames(
    check: WiringCheck,
    handles: Any,
    target: Any,
    bend: Any,
    duration_s: float,
    background: bool = True,
) -> None:
    """Let a check see handles h(t) at 50 Hz and, at 25 Hz, a target at an angle and a bend."""
    before = np.zeros(2)
    for n in range(round(duration_s / 0.02)):
        t = 0.02 * n
        check.follow(t, tuple(handles(t)))
        if n % 2 or n < 20:
            continue
        exposed = t - 0.4
        up_down, left_right = target(exposed) - bend(exposed)
        # right of the axis by left_right, above it by up_down; the tip's rotation moves the camera
        off = np.array([np.tan(left_right), -np.tan(up_down), 1.0])
        now = np.array(bend(exposed))
        turned: Pair | None = tuple((now - before).tolist()) if background else None
        before = now
        check.look(exposed, 10.0 * off, turned, (1e-6, 4e-8))  # far away: no lever


@pytest.mark.parametrize(
    ("period_s", "still", "background"),
    [(2.0, 0.4, True), (3.0, 0.4, True), (6.0, 0.4, False), (12.0, 0.4, False), (4.0, 0.2, False)],
)
def test_a_handle_that_follows_the_target_within_its_dead_band_is_not_accused(
    period_s: float, still: float, background: bool
) -> None:
    # The handle copies the target without delay while the tip stays: as if it turned the tip away
    # by just as much while the target stays. A background shows that the tip stays; without one,
    # only handles that move more suddenly than targets do could tell.
    def path(t: float) -> np.ndarray:
        return still * np.array([0.0, 1 - np.cos(2 * pi * t / period_s)]) / 2

    check = WiringCheck(SectionGeometry())
    _handles_and_frames(check, path, path, lambda t: np.zeros(2), 20.0, background)
    assert check.open[1]  # nor is it called right


@pytest.mark.parametrize(("seed", "most"), [(11, 0.12), (20, 0.12), (116, 0.58)])
def test_a_handle_that_wanders_while_the_other_one_turns_the_tip_is_not_accused(
    seed: int, most: float
) -> None:
    # Up-down stays within its dead band, in step with left-right, which bends the tip through
    # several plays and a lag: no single play explains that, and the wandering fits what is left.
    random = np.random.default_rng(seed)
    period_s, swing, wander = random.uniform((4.0, 0.4, 0.15), (14.0, 0.9, 0.3))
    phase, turns = random.uniform(0.0, 2 * pi), int(random.integers(1, 3))
    ahead_s, leak, slope = random.uniform((0.2, -most, 0.5), (1.2, most, 1.0))
    radii, weights = np.array([0.02, 0.1, 0.2, 0.3]), random.dirichlet(np.ones(4))
    times = np.arange(-1.0, 41.0, 0.02)
    left_right = swing * np.clip(1.4 * np.sin(2 * pi * times / period_s), -1.0, 1.0)
    up_down = wander * np.clip(1.5 * np.sin(2 * pi * turns * times / period_s + phase), -1.0, 1.0)
    plays, bends = np.zeros(4), [0.0]
    for h in left_right:
        plays = np.clip(plays, h - radii, h + radii)
        bends.append(bends[-1] + (slope * float(weights @ plays) - bends[-1]) * 0.02 / 0.15)
    tip = np.array(bends[1:])

    def handles(t: float) -> np.ndarray:
        return np.array([np.interp(t, times, up_down), np.interp(t, times, left_right)])

    def bend(t: float) -> np.ndarray:  # the camera is rotated
        moved = float(np.interp(t, times, tip))
        return np.array([leak * moved, moved])

    def target(t: float) -> np.ndarray:
        return np.array([0.0, 0.5 * np.sin(2 * pi * (t + ahead_s) / period_s)])

    check = WiringCheck(SectionGeometry())
    _handles_and_frames(check, handles, target, bend, 40.0)
    assert check.open[0]  # nor is it called right


def test_a_push_that_the_handles_counter_does_not_accuse_them() -> None:
    # The tip is pushed by 0.4 rad within 1 s; half a second later the handle turns it back.
    def push(t: float) -> np.ndarray:
        s = min(max(t - 5.0, 0.0), 1.0)
        return np.array([0.0, 0.4 * s * s * (3 - 2 * s)])

    def handles(t: float) -> np.ndarray:
        return -push(t - 0.5)

    check = WiringCheck(SectionGeometry())
    _handles_and_frames(check, handles, lambda t: np.zeros(2), lambda t: push(t) + handles(t), 12.0)


def test_without_a_background_a_tip_that_runs_away_from_a_still_target_is_noticed() -> None:
    # Steps of 0.2 rad that move the tip, and so the target in the picture, the wrong way at once.
    def handles(t: float) -> np.ndarray:
        return np.array([0.0, 0.2 * min(int(t / 1.5), 3)])

    check = WiringCheck(SectionGeometry())
    with pytest.raises(WiringError, match="handle left_right turns the tip the wrong way"):
        _handles_and_frames(
            check, handles, lambda t: np.zeros(2), lambda t: -handles(t), 8.0, False
        )


@pytest.mark.parametrize("rolled_deg", [90, -90, 180])
def test_a_camera_rotated_by_a_right_angle_is_said(rolled_deg: int) -> None:
    instrument = Instrument(misalignment_rad=radians(rolled_deg))
    _, error, _ = _run("circle", SAME, duration_s=8.0, instrument=instrument)
    assert error is not None
    said = f"{rolled_deg:+d} deg" if rolled_deg != 180 else "180 deg"
    assert f"if the camera is rotated by about {said}, rotate it back" in error.next_step


@pytest.mark.parametrize("rolled_deg", [-30, 30])
def test_a_camera_rotated_by_30_deg_is_none_of_its_business(rolled_deg: int) -> None:
    instrument = Instrument(misalignment_rad=radians(rolled_deg))
    for background in (True, False):
        _, error, _ = _run(
            "circle", SAME, duration_s=10.0, background=background, instrument=instrument
        )
        assert error is None
