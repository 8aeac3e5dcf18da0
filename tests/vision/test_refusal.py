"""Reasons to refuse a frame."""

from dataclasses import replace

import numpy as np
import pytest

from endolock.hw.api import Frame
from endolock.vision import camera_model, refusal

CAMERA = camera_model.from_fovy(64, 48, 85.0)
GREY = np.full((48, 64, 3), 120, np.uint8)
FRAME = Frame(image=GREY, t_capture=0.0, t_available=0.4, seq=3, dropped=0)


@pytest.mark.parametrize(
    ("frame", "why"),
    [
        (FRAME, ""),
        (replace(FRAME, image=None), "no picture in the frame"),
        (replace(FRAME, image=GREY[:40]), "picture is 64x40 px, calibrated for 64x48 px"),
        (replace(FRAME, image=GREY[..., 0]), "picture is 64x48 px, calibrated for 64x48 px"),
        (replace(FRAME, repeated=True), "picture repeated"),
        (replace(FRAME, image=GREY // 40), "picture is black"),
        (replace(FRAME, image=GREY + 135), "picture is saturated"),
    ],
)
def test_the_reason_is_returned(frame: Frame, why: str) -> None:
    assert refusal.reason(frame, CAMERA) == why


def test_only_the_middle_counts() -> None:
    """An endoscope's picture has black corners."""
    image = np.zeros_like(GREY)
    image[12:36, 16:48] = 120
    assert refusal.reason(replace(FRAME, image=image), CAMERA) == ""
    assert refusal.reason(replace(FRAME, image=120 - image), CAMERA) == "picture is black"
