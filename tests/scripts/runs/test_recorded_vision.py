"""Vision on a recording, from objects."""

from pathlib import Path

from endolock.scripts.runs import run_folder
from endolock.scripts.runs.experiment import Experiment
from endolock.scripts.runs.recorded_vision import RecordedVision
from endolock.twin.rig import TwinRig
from endolock.vision.marker_eyes import MarkerEyes


def test_eyes_can_be_an_object(tmp_path: Path) -> None:
    run = Experiment(scenario="rest", duration_s=1.0, out=tmp_path / "run").run()
    with TwinRig("rest", pictures=False) as rig:
        eyes = MarkerEyes(rig.camera.calibration, rig.board)
    seen = RecordedVision(source=run.folder, vision=eyes, out=tmp_path / "again").run()
    named = RecordedVision(source=run.folder).run()
    assert seen.vision == "MarkerEyes"
    assert seen.frames == named.frames == run.frames > 0
    assert seen.delayed_error_px == named.delayed_error_px
    assert run_folder.read(tmp_path / "again", "frames").num_rows == seen.frames
