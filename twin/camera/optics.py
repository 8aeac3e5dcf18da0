"""From rendered pictures to those of an endoscope's camera.

In this order: average over an exposure, fisheye projection, gain with vignette and mask, sensor
noise, coding artefacts. Each part is skipped if the scenario leaves it ideal.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan, ceil, degrees, hypot, radians
from typing import NamedTuple

import cv2
import numpy as np

from endolock.hw.api import Calibration, Image, Vector
from endolock.twin.randomness import generator
from endolock.twin.world.scenario_sections import FISHEYE_MARGIN, CameraSettings
from endolock.vision import camera_model

NOISE_BANK = 4
"""Size of the bank of noise, in pictures; each frame starts at a random row of it."""


class Shot(NamedTuple):
    """Size and field of view of the rendered picture, of an ideal pinhole."""

    width: int
    height: int
    fovy_deg: float


def calibration(camera: CameraSettings) -> Calibration:
    """Return the geometry of the delivered pictures."""
    width, height = camera.width, camera.height
    if camera.projection == "pinhole":
        ideal = camera_model.from_fovy(width, height, camera.fovy_deg)
        focal_px = ideal.focal_px
    else:
        focal_px = hypot(width, height) / radians(camera.diagonal_deg)
    return Calibration(
        width=width,
        height=height,
        focal_px=focal_px,
        centre_px=((width - 1) / 2, (height - 1) / 2),
        projection=camera.projection,
        mask=camera.mask,
    )


def shot(camera: CameraSettings) -> Shot:
    """Return the picture to render: as delivered, or wide enough to cover the fisheye."""
    width, height = camera.width, camera.height
    if camera.projection == "pinhole":
        return Shot(width, height, camera.fovy_deg)
    fisheye = calibration(camera)
    seen = np.abs(_rays(fisheye)[camera_model.visible(fisheye).ravel()]).max(axis=0)
    focal_px = FISHEYE_MARGIN * fisheye.focal_px
    across, down = (2 * ceil(focal_px * float(side) + 1) for side in seen[:2])
    return Shot(across, down, degrees(2 * atan(down / 2 / focal_px)))


class Optics:
    """Turns rendered pictures into delivered ones.

    Args:
        camera: settings of the camera.
        seed: seed of the sensor noise.
    """

    def __init__(self, camera: CameraSettings, seed: int) -> None:
        self._quality = camera.jpeg_quality
        geometry = calibration(camera)
        self._maps = _maps(geometry, shot(camera)) if camera.projection != "pinhole" else None
        self._weight: Image | None = None
        self._scale = 1.0
        if camera.gain != 1.0 or camera.vignette or camera.mask != "none":
            self._weight, self._scale = _weight(camera, geometry), camera.gain / 255
        self._random = generator(seed, "camera.noise")
        self._noise: np.ndarray | None = None
        if camera.noise:
            shape = (NOISE_BANK * camera.height, camera.width, 3)
            drawn = self._random.standard_normal(shape, np.float32) * camera.noise
            self._noise = np.rint(np.clip(drawn, -128, 127)).astype(np.int16)

    def develop(self, pictures: Sequence[Image]) -> Image:
        """Make one delivered picture.

        Args:
            pictures: pictures rendered during one exposure, RGB; at least one.
        """
        image: np.ndarray = pictures[0]
        if len(pictures) > 1:
            total = np.zeros(image.shape, np.float32)
            for picture in pictures:
                cv2.accumulate(picture, total)
            image = cv2.convertScaleAbs(total, alpha=1 / len(pictures))
        if self._maps:
            image = cv2.remap(image, *self._maps, cv2.INTER_LINEAR)
        if self._weight is not None:
            image = cv2.multiply(image, self._weight, scale=self._scale)
        if self._noise is not None:
            height = image.shape[0]
            first = int(self._random.integers(len(self._noise) - height + 1))
            noise = self._noise[first : first + height]
            image = cv2.add(image, noise, dtype=cv2.CV_8U)
        if self._quality:
            coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, self._quality])[1]
            image = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR))
        return np.asarray(image, np.uint8)


def _maps(delivered: Calibration, rendered: Shot) -> tuple[np.ndarray, np.ndarray]:
    """Position in the rendered picture of each delivered pixel, for `cv2.remap`."""
    pinhole = camera_model.from_fovy(*rendered)
    seen = camera_model.project_points(pinhole, _rays(delivered)).astype(np.float32)
    x, y = (seen[:, i].reshape(delivered.height, delivered.width) for i in (0, 1))
    return cv2.convertMaps(x, y, cv2.CV_16SC2)


def _rays(delivered: Calibration) -> Vector:
    """Rays of all pixels, row by row."""
    v, u = np.indices((delivered.height, delivered.width), np.float64)
    return camera_model.rays(delivered, np.column_stack([u.ravel(), v.ravel()]))


def _weight(camera: CameraSettings, geometry: Calibration) -> Image:
    """Share of the light at each pixel, times 255."""
    v, u = np.indices((camera.height, camera.width), np.float64)
    cx, cy = geometry.centre_px
    radius = np.hypot(u - cx, v - cy) / hypot(cx, cy)
    share = (1 - camera.vignette * radius**4) * camera_model.visible(geometry)
    return np.repeat(np.rint(255 * share).astype(np.uint8)[..., None], 3, axis=2)
