"""Draws a seamless texture that resembles tissue: pink and blotchy, with vessels.

It is made of smooth random fields: a coarse one for the colour, the zero lines of two finer ones as
vessels, a fine one as grain. Assumed, as a stand-in for mucosa.
"""

from __future__ import annotations

import cv2
import numpy as np

from endolock.hw.api import Image, Vector

BASE = (206, 128, 112)
BLOTCH = (26.0, 22.0, 18.0)
VESSEL = (150, 44, 48)


def picture(pixels: int, period: float, seed: int) -> Image:
    """Draw a seamless square texture, RGB.

    Args:
        pixels: side of the square [px].
        period: size of the blotches [px]; vessels are about an eighth of it apart.
        seed: seed of the noise.
    """
    random = np.random.default_rng(seed)
    coarse = _field(random, pixels, period)
    vessels = np.exp(-((_field(random, pixels, period / 2) / 0.10) ** 2))
    fine = np.exp(-((_field(random, pixels, period / 5) / 0.07) ** 2))
    grain = _field(random, pixels, period / 16)
    image = np.array(BASE) + coarse[..., None] * BLOTCH + 5.0 * grain[..., None]
    for strength, veins in ((0.75, vessels), (0.35, fine)):
        share = strength * veins[..., None]
        image = (1 - share) * image + share * np.array(VESSEL)
    return np.asarray(np.clip(image, 0, 255), np.uint8)


def _field(random: np.random.Generator, pixels: int, period: float) -> Vector:
    """Return periodic noise of unit variance, smooth on scales below `period` [px]."""
    sigma = period / 4
    noise = random.standard_normal((pixels, pixels))
    frequency = np.fft.fftfreq(pixels)
    squared = frequency[:, None] ** 2 + frequency**2
    smooth = np.fft.ifft2(np.fft.fft2(noise) * np.exp(-2 * (np.pi * sigma) ** 2 * squared)).real
    field: Vector = (smooth - smooth.mean()) / smooth.std()
    return field


def disc(diameter: int, seed: int) -> Image:
    """Draw a round patch of that diameter [px] in a square picture, black outside."""
    image = picture(diameter, diameter / 3, seed)
    inside = np.zeros((diameter, diameter), np.uint8)
    centre = (diameter - 1) * 8
    cv2.circle(inside, (centre, centre), diameter * 8, 255, cv2.FILLED, cv2.LINE_8, shift=4)
    return np.asarray(cv2.bitwise_and(image, image, mask=inside), np.uint8)
