"""Grey pictures: the conversion that all vision shares, and smoothing for noisy cameras."""

from __future__ import annotations

import cv2
import numpy as np

from endolock.hw.api import Image

NOISY = 5.0
"""Smooth pictures with more noise than this [grey levels]. At 20 grey levels marker detection would
take ten times as long without, because every speck is a candidate."""


def grey_of(image: Image) -> Image:
    """Convert an RGB picture to grey, 0.299 R + 0.587 G + 0.114 B."""
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)


def smoothed(grey: Image) -> Image:
    """Return a grey picture, smoothed over 3x3 pixels if its noise is above `NOISY`.

    For the marker detector only: the trackers compare pictures with the same noise in both.
    """
    if _noise(grey) > NOISY:
        return np.asarray(cv2.GaussianBlur(grey, (3, 3), 0), np.uint8)
    return grey


def _noise(grey: Image) -> float:
    """Estimate the standard deviation of a picture's noise [grey levels] from some of its rows.

    The median of |second difference| is 0.6745 sqrt(6) times that of white noise; edges are few
    and do not move a median.
    """
    rows = grey[::24].astype(np.int16)
    return float(np.median(np.abs(rows[:, 2:] - 2 * rows[:, 1:-1] + rows[:, :-2]))) / 1.652
