"""What `endolock run` says about a run that saw nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from endolock.hw.api import Frame
from endolock.scripts.commands.run import unseen
from endolock.scripts.runs.experiment import Experiment
from endolock.twin.rig import TwinRig
from endolock.twin.world import scenario
from endolock.vision.marker_eyes import MIRRORED, MarkerEyes
from endolock.vision.observation import Observation


def test_the_reason_is_told_where_most_pictures_show_no_target(tmp_path: Path) -> None:
    rest = scenario.load("rest").model_copy(update={"duration_s": 1.0, "scored_from_s": 0.0})
    for flipped in (True, False):
        with TwinRig(rest, seed=0) as rig:
            eyes = MarkerEyes(rig.camera.calibration, rig.board)

            def look(frame: Frame, eyes: MarkerEyes = eyes, flipped: bool = flipped) -> Observation:
                """See the picture, or its mirror image."""
                if flipped and frame.image is not None:
                    frame = replace(frame, image=frame.image[:, ::-1])
                return eyes(frame)

            out = tmp_path / f"{flipped}"
            record = Experiment(scenario=rest, rig=rig, vision=look, out=out).run()
        notes = unseen(out)
        assert len(notes) == flipped
        if flipped:
            assert f"{record.frames} of {record.frames} pictures" in notes[0]
            assert MIRRORED in notes[0]
