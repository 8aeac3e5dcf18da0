"""Eyes that follow a selected target without markers, which serve only as ground truth.

The target is a given rectangle of the first picture, or a window around the board's target when the
markers first show it. Markers around the target give its true position in every frame. The tracker
does not use them, so its error can be measured on a bench as on the twin.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from endolock.hw.api import BoardGeometry, Calibration, ConfigError, Frame
from endolock.vision import camera_model, refusal
from endolock.vision.ego_motion import LEVER_M
from endolock.vision.feature_tracker import FeatureTracker
from endolock.vision.grey import grey_of
from endolock.vision.marker_eyes import MIRRORED, BoardFit, MarkerEyes
from endolock.vision.observation import Lock, Observation
from endolock.vision.turning import Turning

HALF_PX = 20
"""Half side of the window around the board's target, without a selection [px]."""
SMALLEST_PX = 16
"""Least side of a selection [px]."""

BESIDE = 3.0
"""Half side of the window that is left out for the background where no markers are seen, over that
of the target's [1]. Assumed: what moves with a target reaches beyond it by its width."""

Selection = tuple[int, int, int, int]
"""Left, top, width and height of a rectangle in the picture [px]."""


class TrackEyes:
    """Eyes that follow a selected target without markers.

    Args:
        calibration: the camera's geometry.
        board: the markers around the target, used only as ground truth.
        selection: rectangle to follow; a window around the board's target if None.
        lever_m: distance from the camera to the point about which the section turns it [m].

    Raises:
        ConfigError: the selection is not within the picture, or too small.
    """

    def __init__(
        self,
        calibration: Calibration,
        board: BoardGeometry,
        selection: Selection | None = None,
        lever_m: float = LEVER_M,
    ) -> None:
        if selection is not None:
            check(selection, calibration)
        self._calibration, self._selection = calibration, selection
        self._markers = MarkerEyes(calibration, board)
        self._tracker: FeatureTracker | None = None
        self._lock = Lock()
        self._turning = Turning(calibration, board.size_m, lever_m)
        self._beside_px = BESIDE * (max(selection[2:]) / 2 if selection else HALF_PX)

    def __call__(self, frame: Frame) -> Observation:
        """Find the target in one frame.

        Raises:
            ConfigError: the selection has too little texture.
        """
        blank = Observation(
            t_capture=frame.t_capture, seq=frame.seq, status=self._lock.status, why=""
        )
        why = refusal.reason(frame, self._calibration)
        if why or frame.image is None:
            return replace(blank, status=self._lock.step(False), why=why)
        grey = grey_of(frame.image)
        found, fit = self._markers.look(frame)
        corners = tuple((float(u), float(v)) for four, _ in found for u, v in four)
        if fit == MIRRORED:
            return replace(blank, status=self._lock.step(False), why=fit, corners_px=corners)
        if self._tracker is None:
            why = self._start(grey, fit)
            if why:
                status = self._lock.step(False)
                return replace(blank, status=status, why=why, corners_px=corners)
            found, fit = self._markers.look(frame)
        assert self._tracker is not None
        track = self._tracker.step(grey)
        observation = replace(
            blank,
            corners_px=corners,
            reference_px=blank.target_px if isinstance(fit, str) else fit.pixel,
            turn=self._turning(
                frame,
                None if isinstance(fit, str) else fit.pose,
                None if isinstance(track, str) else (track.pixel, self._beside_px * track.scale),
            ),
        )
        if isinstance(track, str):
            return replace(observation, status=self._lock.step(False), why=track)
        return replace(
            observation,
            status=self._lock.step(True),
            target_px=track.pixel,
            covariance=track.covariance,
        )

    def _start(self, grey: np.ndarray, fit: BoardFit | str) -> str:
        """Make the reference; return the reason if this picture does not allow it, or nothing."""
        if self._selection is None:
            if isinstance(fit, str):
                return f"no target to start from: {fit}"
            centre, half = fit.pixel, (HALF_PX, HALF_PX)
        else:
            left, top, width, height = self._selection
            centre = left + (width - 1) / 2, top + (height - 1) / 2
            half = (width - 1) // 2, (height - 1) // 2
        try:
            self._tracker = FeatureTracker(np.asarray(grey, np.uint8), centre, half)
        except ValueError as error:
            if self._selection is None:
                return str(error)
            text = ",".join(str(n) for n in self._selection)
            raise ConfigError(f"--select {text}: {error}", "select another rectangle") from None
        if self._selection is not None and not isinstance(fit, str):
            self._markers.target = fit.pose.under(camera_model.ray(self._calibration, centre))
        return ""


def check(selection: Selection, calibration: Calibration) -> None:
    """Check that a rectangle is within the picture and large enough.

    Raises:
        ConfigError: it is not.
    """
    left, top, width, height = selection
    text = ",".join(str(n) for n in selection)
    if min(width, height) < SMALLEST_PX:
        raise ConfigError(
            f"--select {text}: {width}x{height} px is too small to follow",
            f"use {SMALLEST_PX} px or more on each side",
        )
    corners = [(left, top), (left + width - 1, top + height - 1)]
    corners += [(left + width - 1, top), (left, top + height - 1)]
    if not all(camera_model.in_picture(calibration, (u, v)) for u, v in corners):
        raise ConfigError(
            f"--select {text} reaches beyond the picture of {calibration.width}x"
            f"{calibration.height} px",
            "give x,y,width,height within it",
        )
