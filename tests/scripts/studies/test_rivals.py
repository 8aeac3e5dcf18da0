"""References for controllers: holding still, the best constant handle angle, a following tip."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from endolock.control import loop, metrics, registry
from endolock.control.scores import ErrorSummary, HandleScores
from endolock.control.transmission.plays import Plays
from endolock.hw.api import Command, State
from endolock.scripts import cli
from endolock.scripts.runs import batch, record_table
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.run_record import RunRecord
from endolock.scripts.runs.target_path import hindsight, sample_path
from endolock.twin.rig import TwinRig
from endolock.twin.surrogate import SurrogateRig
from endolock.twin.world import scenario
from endolock.twin.world.instrument import Instrument
from endolock.vision import camera_model
from endolock.vision.observation import Observation
from endolock.vision.truth_eyes import TruthEyes

MAY_STAND = {"still"}
"""Controllers that do not claim to follow."""
DIRECT = Plays(radii=(0.0,), weights=(1.0,))
SCORED = {"duration_s": 20.0, "scored_from_s": 5.0}


class Held:
    """Turns the handles to an angle and holds them there."""

    def __init__(self, handles: tuple[float, float]) -> None:
        self._handles = handles

    def reset(self, state: State) -> None:
        """No state to reset."""

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Hold."""
        return Command(position=self._handles)


def held(name: str, handles: tuple[float, float]) -> float:
    """Rms error of a constant handle angle, without hysteresis and with exact kinematics [px]."""
    rig = SurrogateRig(scenario.load(name, SCORED), transmission=DIRECT)
    with rig:
        rig.clock.sleep_until(0.0)
        camera = rig.camera.calibration
        ran = loop.run(rig, TruthEyes(rig.truth), Held(handles), duration_s=SCORED["duration_s"])
        return float(
            metrics.score(ran, camera, SCORED["scored_from_s"]).as_dict()["error_px"]["rms"]
        )


@pytest.mark.parametrize(
    "name", ["straight", pytest.param("circle", marks=pytest.mark.slow), "random"]
)
def test_no_constant_handle_is_better_than_the_best_in_hindsight(name: str) -> None:
    best = hindsight(scenario.load(name, SCORED), Instrument(), 0).constant_px
    assert best
    bound = float(best.rms or 0.0)
    around = np.arange(0.0, 0.71, 0.1) if name == "straight" else np.arange(-0.4, 0.41, 0.1)
    across = [0.0] if name == "straight" else around
    tried = min(held(name, (float(a), float(b))) for a in across for b in around)
    # The path is sampled every 0.1 s; half a step of the grid is 0.05 rad, 19 px on each axis.
    assert bound - 0.5 <= tried <= float(np.hypot(bound, 27.0))


def test_a_path_needs_the_bends_that_point_at_it() -> None:
    path = hindsight(scenario.load("straight", SCORED), Instrument(), 0)
    assert path.needed_tip_deg[0] == 0.0
    # r cos t - z sin t + L (1 - cos t)/t = 0 with r = 130, z = 210, L = 75 mm
    t = np.radians(path.needed_tip_deg[1])
    assert 130 * np.cos(t) - 210 * np.sin(t) + 75 * (1 - np.cos(t)) / t == pytest.approx(0, abs=0.1)


@pytest.mark.parametrize("seed", [0, 3])
def test_the_path_is_that_of_the_twin(seed: int) -> None:
    rolled = {
        # The target of this board is off its centre, so that the tilt counts.
        **{"duration_s": 4.0, "scored_from_s": 0.0, "board.kind": "several", "board.target": 1},
        **{"board.tilt_deg": 20.0, "board.tilt_axis_deg": 30.0},
        "shaft": [{"kind": "roll", "by_deg": 20.0, "start_s": 1.0, "over_s": 1.0}],
    }
    task = scenario.load("random", rolled)
    path = sample_path(task, seed)
    with TwinRig(task, pictures=False, seed=seed) as rig:
        camera = rig.camera.calibration
        for n in (5, 20, 38):
            rig.clock.sleep_until(0.1 * n)
            shown = rig.truth.now().target_px
            # At rest and without gravity the section looks straight ahead, but for the solver's
            # rest state: hundredths of a degree, 0.05 px each.
            assert camera_model.project(camera, path[n]) == pytest.approx(shown, abs=0.5)


@pytest.fixture(scope="module")
def followers() -> dict[tuple[str, str], batch.FinishedRun]:
    names = sorted(set(registry.LAWS) - MAY_STAND)
    cases = [(path, law) for path in ("straight", "circle") for law in names]
    asked = [
        Experiment(
            scenario=path,
            controller=law,
            vision="truth",
            # Two periods of the path; `repetitive` learns over the periods before.
            duration_s=100.0 if law == "repetitive" else 36.0,
            scored_from_s=80.0 if law == "repetitive" else 18.0,
        )
        for path, law in cases
    ]
    return dict(zip(cases, batch.all_of(asked), strict=True))


@pytest.mark.parametrize("path", ["straight", "circle"])
@pytest.mark.parametrize("law", sorted(set(registry.LAWS) - MAY_STAND))
def test_a_controller_that_claims_to_follow_moves_the_tip(
    path: str, law: str, followers: dict[tuple[str, str], batch.FinishedRun]
) -> None:
    one = followers[path, law]
    assert one.follows, (one.record.tip, one.record.needed_tip_deg)


def test_a_ringing_controller_does_not_follow() -> None:
    """At 15 mm the loop is unstable with the gains of `pi` for 12 cm."""
    (one,) = batch.all_of([Experiment(scenario="close", vision="truth")])
    assert one.tip_deg > one.needed_deg  # it moves enough
    assert not one.follows


def test_gains_that_park_the_tip_are_detected() -> None:
    """Kp 0.3 and ki 0.25, calibrated on peaks alone, give the error of a constant handle."""
    (one,) = batch.all_of(
        [
            Experiment(
                scenario="straight",
                vision="truth",
                vary=("law.kp=0.3", "law.ki=0.25"),
                duration_s=60.0,
                scored_from_s=30.0,
            )
        ]
    )
    assert not one.follows
    assert one.tip_deg < 1.0
    assert one.rms == pytest.approx(one.constant_px, rel=0.05)


def test_a_comparison_shows_holding_still_and_the_best_constant(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "rows.json"
    args = ["--scenarios", "straight", "circle", "--controllers", "still", "pi"]
    args += ["--vision", "truth", "--duration-s", "3", "--scored-from-s", "1"]
    assert cli.main(["compare", *args, "--out", str(tmp_path / "all"), "--json", str(file)]) == 0
    said = capsys.readouterr().out
    assert "…" not in said  # cut off
    lines = [line.split() for line in said.splitlines()]
    assert lines[0][0] == "error"
    for name in ("straight", "circle"):
        own = [line for line in lines if line[:1] == [name] and len(line) > 5]
        errors, handles = ["still", "pi", "constant"], ["still", "pi"]  # two tables
        assert [line[1] for line in own] == errors + handles
    rows = json.loads(file.read_text())["rows"]
    for row in rows:
        assert set(row["tip"]) == {"p2p_deg", "travel_deg"}
        assert len(row["handle"]["p2p_deg"]) == len(row["needed_tip_deg"]) == 2
        assert set(row["constant_px"]) == set(row["error_px"])
    still = rows[0]
    assert still["controller"] == "still"
    assert max(still["tip"]["p2p_deg"]) < 0.01  # encoders' steps may settle
    assert still["error_px"]["rms"] >= still["constant_px"]["rms"] - 0.5  # rest state, see above


@pytest.mark.parametrize(
    "more",
    [
        ["--latencies", "0.2", "0.4"],
        ["--latencies", "0.2", "0.4", "--vary", "board.distance_m=0.06"],
        ["--controllers", "still", "predictive_bank"],
    ],
)
def test_no_table_is_cut_off(
    more: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    args = ["compare", "--scenarios", "shaft_loop", "--vision", "truth", "--duration-s", "2"]
    assert cli.main([*args, "--out", str(tmp_path / "all"), *more]) == 0
    table = capsys.readouterr().out.split("constant:")[0]
    assert "…" not in table
    for heading in ("law", "rms", "max", "tip", "handle"):
        assert heading in table.split()


def test_the_needed_motion_is_that_of_the_nominal_task(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    args = ["compare", "--scenarios", "straight", "--controllers", "still", "--vision", "truth"]
    args += ["--vary", "board.distance_m=0.06", "--out", str(tmp_path / "all")]
    assert cli.main([*args, "--duration-s", "9"]) == 0
    needed = hindsight(scenario.load("straight"), Instrument(), 0).needed_tip_deg
    assert f"straight: the path needs 0 deg of tip up_down, {needed[1]:.0f} left_right" in (
        capsys.readouterr().out
    )


def test_a_pushed_tip_has_no_best_constant_handle() -> None:
    path = hindsight(scenario.load("push"), Instrument(), 0)
    assert path.constant_px is None
    assert max(path.needed_tip_deg) > 0


def test_rows_are_labelled_with_seeds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = ["compare", "--scenarios", "random", "--controllers", "still", "--seeds", "2"]
    args += ["--vision", "truth", "--duration-s", "3", "--out", str(tmp_path / "all")]
    assert cli.main(args) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    rows = [line for line in lines if line[:1] == ["random"]]
    # once in the table of errors, and once in that of the handles, which a constant has not
    assert sorted(line[1:3] for line in rows) == [
        *(["constant", "0"], ["constant", "1"]),
        *(["still", "0"], ["still", "0"], ["still", "1"], ["still", "1"]),
    ]
    assert sum(line[:2] == ["random,", "seed"] for line in lines) == 2


def test_a_bench_has_no_hindsight() -> None:
    row = RunRecord(
        scenario="straight",
        controller="pi",
        variation="",
        rig="serial:PORT",
        instrument="pretensioned",
        vision="markers",
        seed=0,
        duration_s=1.0,
        scored_from_s=0.0,
        wall_s=1.0,
        real_time_factor=1.0,
        latency_s=0.4,
        interrupted=False,
        needed_tip_deg=None,
        constant_px=None,
        folder=Path(),
        overruns=0,
        frames=0,
        frames_dropped=0,
        detected_fraction=None,
        lost_fraction=None,
        time_to_lock_s=None,
        error_px=None,
        error_deg=None,
        delayed_error_px=ErrorSummary(),
        vision_error_px=None,
        handle=HandleScores(),
        tip=None,
        blur_px=None,
    )
    assert list(record_table.with_constants([row])) == [row]
