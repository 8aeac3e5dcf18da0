"""Grey pictures: one conversion for all eyes, and smoothing of noisy pictures only."""

import cv2
import numpy as np
import pytest

from endolock.hw.api import Image
from endolock.vision.grey import NOISY, grey_of, smoothed

RANDOM = np.random.default_rng(0)


@pytest.mark.parametrize(
    ("colour", "grey"),
    [((255, 0, 0), 76), ((0, 255, 0), 150), ((0, 0, 255), 29), ((90, 90, 90), 90)],
)
def test_channels_are_red_green_blue(colour: tuple[int, int, int], grey: int) -> None:
    assert grey_of(np.full((2, 2, 3), colour, np.uint8)).tolist() == [[grey] * 2] * 2


def test_marker_detector_and_tracker_see_the_same_grey_in_a_clean_picture() -> None:
    image = _picture(noise=0.8 * NOISY)
    assert np.array_equal(smoothed(grey_of(image)), grey_of(image))


def test_only_the_marker_detector_sees_a_noisy_picture_smoothed() -> None:
    grey = grey_of(_picture(noise=4 * NOISY))
    assert np.array_equal(smoothed(grey), cv2.GaussianBlur(grey, (3, 3), 0))


def _picture(noise: float) -> Image:
    """Draw a ramp with white noise [grey levels], the same in all channels."""
    ramp = np.linspace(60, 190, 640) + np.zeros((480, 1))
    noisy = ramp + noise * RANDOM.standard_normal((480, 640))
    return np.repeat(np.rint(noisy).astype(np.uint8)[..., None], 3, axis=2)
