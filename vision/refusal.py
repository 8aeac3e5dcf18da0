"""Frames in which nothing can be seen, whoever looks: the reasons are the same for all eyes."""

from __future__ import annotations

import cv2

from endolock.hw.api import Calibration, Frame

BLACK = 8
WHITE = 247
"""A picture whose lightest (darkest) parts are below (above) this grey shows nothing. Assumed."""
SAMPLING = 8
"""Every so many pixels are looked at, in both directions."""


def reason(frame: Frame, calibration: Calibration) -> str:
    """Say why a frame cannot show anything; empty if it may.

    Args:
        frame: what was delivered.
        calibration: its size is what the picture must have.
    """
    image = frame.image
    if image is None:
        return "no picture in the frame"
    wanted = (calibration.height, calibration.width, 3)
    if image.shape != wanted:
        size = "x".join(str(n) for n in image.shape[1::-1])
        return f"picture is {size} px, calibrated for {calibration.width}x{calibration.height} px"
    if frame.repeated:
        return "picture repeated"
    # The middle half: the corners of an endoscope's picture are black.
    height, width, _ = image.shape
    middle = image[height // 4 : -height // 4 : SAMPLING, width // 4 : -width // 4 : SAMPLING]
    low, high, _, _ = cv2.minMaxLoc(middle.reshape(-1, 1))
    if high < BLACK:
        return "picture is black"
    return "picture is saturated" if low > WHITE else ""
