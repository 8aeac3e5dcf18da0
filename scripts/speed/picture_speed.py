"""Speed of rendering and of vision, per picture."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from endolock.hw.api import Frame
from endolock.scripts.speed.median_times import median_times
from endolock.twin.camera.renderer import Renderer
from endolock.twin.model import scene
from endolock.twin.rig import TwinRig
from endolock.vision.feature_tracker import FeatureTracker
from endolock.vision.grey import grey_of
from endolock.vision.marker_eyes import MarkerEyes
from endolock.vision.track_eyes import HALF_PX


def render() -> dict[str, Any]:
    """Time one tip picture of 640x480 px, and a raw textured quad of that size with read-back."""
    with TwinRig("straight", pictures=False) as rig:
        model, data = rig.plant.model, rig.plant.data
        index = scene.camera_id(model, "tip")
        renderer = Renderer(model)
        draw = _raw_quad(640, 480)
        ours, raw = median_times(
            lambda: renderer.draw(data, index, 640, 480), draw, repeat=60, warm_up=True
        )
        renderer.close()
    return {"ms_640x480": 1e3 * ours, "over_raw_quad": ours / raw}


def vision() -> dict[str, Any]:
    """Time one observation of the marker board, and one step of the markerless tracker."""
    frame, eyes = _frame_and_eyes()
    assert frame.image is not None
    grey = grey_of(frame.image)
    tracker = FeatureTracker(grey, eyes(frame).target_px, (HALF_PX, HALF_PX))
    markers_s, tracker_s = median_times(
        lambda: eyes(frame), lambda: tracker.step(grey), repeat=60, warm_up=True
    )
    return {"markers_ms": 1e3 * markers_s, "tracker_ms": 1e3 * tracker_s}


def _frame_and_eyes() -> tuple[Frame, MarkerEyes]:
    with TwinRig("straight") as rig:
        rig.clock.sleep_until(0.4)
        frame = rig.camera.latest()
        assert frame is not None
        return frame, MarkerEyes(rig.camera.calibration, rig.board)


def _raw_quad(width: int, height: int) -> Callable[[], object]:
    """Return a minimal function that draws a textured picture off-screen and reads it back."""
    context = mujoco.GLContext(width, height)
    context.make_current()
    from OpenGL import GL as gl

    buffers = gl.glGenRenderbuffers(2)
    frame = gl.glGenFramebuffers(1)
    texture = gl.glGenTextures(1)
    image = np.random.default_rng(0).integers(0, 255, (512, 512, 3), np.uint8)

    def bind() -> None:
        context.make_current()
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, frame)

    bind()
    for buffer, kind, attachment in (
        (buffers[0], gl.GL_RGBA8, gl.GL_COLOR_ATTACHMENT0),
        (buffers[1], gl.GL_DEPTH_COMPONENT24, gl.GL_DEPTH_ATTACHMENT),
    ):
        gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, buffer)
        gl.glRenderbufferStorage(gl.GL_RENDERBUFFER, kind, width, height)
        gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, attachment, gl.GL_RENDERBUFFER, buffer)
    gl.glBindTexture(gl.GL_TEXTURE_2D, texture)
    gl.glTexParameteri(gl.GL_TEXTURE_2D, gl.GL_TEXTURE_MIN_FILTER, gl.GL_LINEAR)
    gl.glTexImage2D(
        gl.GL_TEXTURE_2D, 0, gl.GL_RGB, 512, 512, 0, gl.GL_RGB, gl.GL_UNSIGNED_BYTE, image
    )
    gl.glEnable(gl.GL_TEXTURE_2D)
    gl.glPixelStorei(gl.GL_PACK_ALIGNMENT, 1)
    out = np.empty((height, width, 3), np.uint8)

    def draw() -> object:
        bind()
        gl.glViewport(0, 0, width, height)
        gl.glClear(gl.GL_COLOR_BUFFER_BIT | gl.GL_DEPTH_BUFFER_BIT)
        gl.glBegin(gl.GL_QUADS)
        for s, t in ((0, 0), (1, 0), (1, 1), (0, 1)):
            gl.glTexCoord2f(s, t)
            gl.glVertex2f(2 * s - 1, 2 * t - 1)
        gl.glEnd()
        gl.glReadPixels(0, 0, width, height, gl.GL_RGB, gl.GL_UNSIGNED_BYTE, out)
        return out

    return draw
