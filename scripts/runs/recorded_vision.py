"""Runs vision on a recording, through the same interfaces as on a live camera.

record = RecordedVision(source=Path("runs/20260101-120000-circle-pi"), vision="track").run()
"""

from __future__ import annotations

import time
from array import array
from collections import Counter
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

from endolock.control import metrics
from endolock.control.loop import Seen
from endolock.control.scores import ErrorExtent, ErrorSummary
from endolock.hw.api import ConfigError
from endolock.hw.camera.recorded_video import PlaybackClock, RecordedCamera
from endolock.scripts.runs import recordings, run_folder
from endolock.vision.marker_eyes import MarkerEyes
from endolock.vision.observation import Eyes
from endolock.vision.track_eyes import Selection, TrackEyes


@dataclass(frozen=True, kw_only=True)
class VisionRecord:
    """What vision saw in a recording, as the JSON of `endolock watch` holds it."""

    frames: int
    """Number of frames."""
    detected_fraction: float | None
    """Fraction of the frames in which the target was found [1]; None without frames."""
    delayed_error_px: ErrorSummary
    """Distance of the target from the image centre, in the frames in which it was found [px]."""
    vision_error_px: ErrorExtent | None
    """Distance of the target from its position by the markers [px]; None where these are not
    compared."""
    vision: str
    """markers or track."""
    vision_ms: float | None
    """Median time of vision per frame [ms]; None without frames."""
    refused: dict[str, int]
    """Number of frames without a target by reason, most frequent first."""
    damage: list[str]
    """What is missing or damaged in the run folder; the rest was seen."""


@dataclass(frozen=True, kw_only=True)
class RecordedVision:
    """Vision on every frame of a run folder, or of a video file with time stamps."""

    source: Path
    """Run folder, or video file."""
    times: Path | None = None
    """CSV file with the time stamps of a video: t_capture, t_available [s]."""
    calibration: Path | None = None
    """TOML file of the camera; required for a video, replaces that of a run folder."""
    board: str | None = None
    """Board: rings, tissue or several; that of the run, or rings, if None."""
    vision: str | Eyes = "markers"
    """markers or track; or what turns a frame into an observation."""
    select: Selection | None = None
    """With track: left, top, width and height of what to follow in the first picture [px]."""
    out: Path | None = None
    """Run folder to write, with pictures and observations, new or empty; None: nothing is
    written."""

    def run(self) -> VisionRecord:
        """Run vision on every frame.

        Raises:
            ConfigError: something is missing or cannot be read.
        """
        recording = recordings.open_(
            self.source, times=self.times, calibration=self.calibration, board=self.board
        )
        if recording.calibration is None:
            raise ConfigError(
                "the camera is unknown", "give its calibration, see endolock calibrate"
            )
        clock = PlaybackClock()
        camera = RecordedCamera(recording.calibration, clock, recording.frames)
        eyes = self._eyes(recording)
        folder = None
        if self.out:
            known = {"calibration": asdict(recording.calibration), "board": asdict(recording.board)}
            folder = run_folder.RunFolder(self.out, {"run": {"source": str(self.source)}, **known})
        scorer, taken = metrics.Scorer(recording.calibration, 0.0), array("d")
        refused: Counter[str] = Counter()
        with folder or nullcontext():
            while (due := camera.due) is not None:
                clock.sleep_until(due)
                frame = camera.latest()
                assert frame is not None
                start = time.perf_counter()
                observation = eyes(frame)
                taken.append(time.perf_counter() - start)
                if observation.why:
                    refused[observation.why] += 1
                seen = Seen(frame=frame, observation=observation, overview=None, truth=None)
                if folder:
                    folder.seen(seen)
                scorer.seen(seen)
        scores = scorer.scores()
        named = isinstance(self.vision, str)
        record = VisionRecord(
            frames=scores.frames,
            detected_fraction=scores.detected_fraction,
            delayed_error_px=scores.delayed_error_px,
            vision_error_px=scores.vision_error_px,
            vision=str(self.vision) if named else type(self.vision).__name__,
            vision_ms=1e3 * median(taken) if taken else None,
            refused=dict(refused.most_common()),
            damage=recording.damage,
        )
        if folder:
            folder.finish(asdict(record))
        return record

    def _eyes(self, recording: recordings.Recording) -> Eyes:
        assert recording.calibration is not None
        if not isinstance(self.vision, str):
            return self.vision
        if self.vision == "track":
            return TrackEyes(recording.calibration, recording.board, self.select)
        if self.vision != "markers":
            raise ConfigError(f"vision '{self.vision}' is unknown here", "use markers or track")
        if self.select:
            raise ConfigError("select goes with vision track, not with markers")
        return MarkerEyes(recording.calibration, recording.board)
