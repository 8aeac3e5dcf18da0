"""Eyes without markers: start, observations, and markers as ground truth."""

from dataclasses import replace

import numpy as np
import pytest

from endolock.control.laws.pi import PI
from endolock.control.loop import Run, run
from endolock.control.metrics import score
from endolock.hw.api import ConfigError, Frame
from endolock.scripts.runs import rigs
from endolock.twin.rig import TwinRig
from endolock.twin.world import scenario
from endolock.twin.world.instrument import Instrument
from endolock.vision.observation import COAST_FRAMES, Status
from endolock.vision.track_eyes import TrackEyes


def test_a_run_is_locked_without_markers_and_measured_with_them() -> None:
    with TwinRig("straight") as rig:
        camera = rig.camera.calibration
        result = run(rig, TrackEyes(camera, rig.board), PI(camera), duration_s=5.0)
    assert all(s.observation.status is Status.TRACKING for s in result.seen)
    scores = score(result, camera, 0.0).as_dict()
    assert scores["vision_error_px"]["max"] < 0.5  # the window is seen at an angle of 30 deg
    without_truth = replace_truth(result)
    judged = score(without_truth, camera, 0.0).as_dict()["vision_error_px"]
    # markers and tracker are each within 0.3 px of the truth
    assert judged["max"] == pytest.approx(scores["vision_error_px"]["max"], abs=0.5)
    assert judged["max"] > 0


def replace_truth(result: Run) -> Run:
    """Return the record that a bench would have of a run."""
    result.seen = [replace(s, truth=None) for s in result.seen]
    result.ticks = [replace(t, truth=None) for t in result.ticks]
    return result


def test_a_selection_becomes_the_target_of_truth_and_markers() -> None:
    loaded = scenario.load("straight", {"camera.latency_s": 0.0})
    select = (340, 200, 41, 41)  # a part of the board off its centre
    rig, eyes = rigs.make(
        "twin", loaded, vision="track", instrument=Instrument(), seed=0, select=select
    )
    assert isinstance(rig, TwinRig)
    with rig:
        errors, apart = [], []
        for n in range(30):
            rig.clock.sleep_until(0.04 * n)
            frame = rig.camera.latest()
            assert frame is not None
            observation = eyes(frame)
            assert observation.status is Status.TRACKING
            true = rig.truth.at_exposure(frame.seq).target_px
            errors.append(np.hypot(*np.subtract(observation.target_px, true)))
            apart.append(np.hypot(*np.subtract(observation.reference_px, true)))
    assert max(errors) < 0.2  # as for the board's own target
    assert max(apart) < 0.3  # a point off the middle, by markers found to 0.15 px


@pytest.mark.parametrize(
    ("select", "why"),
    [
        ((600, 10, 60, 60), "reaches beyond the picture of 640x480 px"),
        ((-5, 10, 60, 60), "reaches beyond the picture"),
        ((100, 100, 10, 60), "10x60 px is too small to follow; use 16 px"),
        ((20, 20, 60, 60), "no board at pixel 49.5,49.5"),
    ],
)
def test_a_selection_that_cannot_be_followed_is_refused(
    select: tuple[int, int, int, int], why: str
) -> None:
    with pytest.raises(ConfigError, match=why):
        rigs.make(
            "twin",
            scenario.load("straight"),
            vision="track",
            instrument=Instrument(),
            seed=0,
            select=select,
        )


def test_a_selection_without_texture_is_refused() -> None:
    frame, rig = _first()
    assert frame.image is not None
    plain = replace(frame, image=np.full_like(frame.image, 120))
    eyes = TrackEyes(rig.camera.calibration, rig.board, (300, 200, 41, 41))
    with pytest.raises(ConfigError, match=r"--select 300,200,41,41: .* too little texture"):
        eyes(plain)


def test_without_a_target_to_start_from_it_searches() -> None:
    frame, rig = _first()
    assert frame.image is not None
    eyes = TrackEyes(rig.camera.calibration, rig.board)
    observation = eyes(replace(frame, image=np.full_like(frame.image, 120)))
    assert observation.status is Status.SEARCHING
    assert observation.why == "no target to start from: 0 markers found, 2 needed"
    assert eyes(frame).status is Status.TRACKING


def test_a_repeated_picture_is_refused() -> None:
    frame, rig = _first()
    eyes = TrackEyes(rig.camera.calibration, rig.board)
    assert eyes(frame).status is Status.TRACKING
    for n in range(1, COAST_FRAMES + 2):
        observation = eyes(replace(frame, seq=frame.seq + n, repeated=True))
        assert observation.status is (Status.COASTING if n <= COAST_FRAMES else Status.LOST)
        assert observation.why == "picture repeated"
        assert np.isnan(observation.target_px).all()


def _first() -> tuple[Frame, TwinRig]:
    with TwinRig(scenario.load("rest", {"camera.latency_s": 0.0})) as rig:
        rig.clock.sleep_until(0.0)
        frame = rig.camera.latest()
        assert frame is not None
        return frame, rig
