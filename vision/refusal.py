"""Reasons to refuse a frame that are the same for all eyes."""

from __future__ import annotations

import cv2

from endolock.hw.api import Calibration, Frame

BLACK = 8
WHITE = 247
"""Grey levels: a picture is refused if its lightest part is below `BLACK`, or its darkest above
`WHITE`. Assumed."""
SAMPLING = 8
"""Distance of the pixels that are sampled, in both directions [px]."""


def reason(frame: Frame, calibration: Calibration) -> str:
    """Return the reason to refuse a frame; empty if it is usable.

    Args:
        frame: the delivered frame.
        calibration: the picture must have its size.
    """
    image = frame.image
    if image is None:
        return "no picture in the frame"
    expected = (calibration.height, calibration.width, 3)
    if image.shape != expected:
        size = "x".join(str(n) for n in image.shape[1::-1])
        return f"picture is {size} px, calibrated for {calibration.width}x{calibration.height} px"
    if frame.repeated:
        return "picture repeated"
    # The middle half, because the corners of an endoscope's picture are black.
    height, width, _ = image.shape
    middle = image[height // 4 : -height // 4 : SAMPLING, width // 4 : -width // 4 : SAMPLING]
    low, high, _, _ = cv2.minMaxLoc(middle.reshape(-1, 1))
    if high < BLACK:
        return "picture is black"
    return "picture is saturated" if low > WHITE else ""
