"""In CI, pictures must be drawn with EGL, not with another installed platform."""

from __future__ import annotations

import os

import numpy as np

import endolock
from endolock.twin.camera.stills import BoardPose, Studio
from endolock.twin.world import scenario


def egl_is_current() -> bool:
    """Return whether this thread has a current EGL context."""
    if endolock.opengl() != "egl":
        return False
    from OpenGL import EGL  # fails to load if MuJoCo uses another platform

    return bool(EGL.eglGetCurrentContext())


def test_in_ci_pictures_are_rendered_with_egl() -> None:
    with Studio(scenario.load("rest")) as studio:
        image = studio.take(BoardPose((0.0, 0.0, 0.12))).frame.image
        assert image is not None
        assert np.std(image) > 10  # it shows the board
        assert egl_is_current() or not os.environ.get("CI")
