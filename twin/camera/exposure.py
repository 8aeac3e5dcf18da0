"""Times at which the twin's camera is exposed: one per frame, or several for motion blur."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from typing import NamedTuple

from endolock.twin.world.scenario_sections import CameraSettings


class SubExposure(NamedTuple):
    """One of the pictures that are averaged over an exposure."""

    step: int
    """Its step on the physics grid."""
    seq: int
    """Number of the frame."""
    first: bool
    """Whether it is the first of its frame."""
    nominal: bool
    """Whether it is in the middle of the exposure, the nominal time of the frame."""
    last: bool
    """Whether it is the last of its frame."""


def sub_exposures(
    camera: CameraSettings, timestep_s: float, *, pictures: bool
) -> Iterator[SubExposure]:
    """Yield all sub-exposures in order; frame n is exposed around n / frame_rate_hz.

    Args:
        camera: settings of the camera.
        timestep_s: the physics grid [s]; times are rounded to it and are not before 0.
        pictures: whether pictures are drawn; otherwise only the middle of each exposure.
    """
    parts = camera.sub_exposures if camera.exposure_s and pictures else 1
    for seq in count():
        for part in range(parts):
            off = ((part + 0.5) / parts - 0.5) * camera.exposure_s
            step = round((seq / camera.frame_rate_hz + off) / timestep_s)
            yield SubExposure(
                max(0, step), seq, part == 0, 2 * part + 1 == parts, part + 1 == parts
            )
