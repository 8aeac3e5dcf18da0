"""When the twin's camera is exposed: one moment a frame, or several where motion shall blur."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from typing import NamedTuple

from endolock.twin.world.scenario_sections import CameraSettings


class SubExposure(NamedTuple):
    """One moment of an exposure."""

    step: int
    """On the physics grid."""
    seq: int
    """Of which frame."""
    first: bool
    """Whether the frame begins with it."""
    nominal: bool
    """Whether the frame counts as taken now: in the middle of its exposure."""
    last: bool
    """Whether the frame is complete after it."""


def sub_exposures(
    camera: CameraSettings, timestep_s: float, *, pictures: bool
) -> Iterator[SubExposure]:
    """Yield all moments in order; frame n is exposed around n / frame_rate_hz.

    Args:
        camera: what the scenario says of the camera.
        timestep_s: the physics grid [s]; moments are rounded to it, none is before 0.
        pictures: whether anything is drawn; without, the middle of the exposure is enough.
    """
    parts = camera.sub_exposures if camera.exposure_s and pictures else 1
    for seq in count():
        for part in range(parts):
            off = ((part + 0.5) / parts - 0.5) * camera.exposure_s
            step = round((seq / camera.frame_rate_hz + off) / timestep_s)
            yield SubExposure(
                max(0, step), seq, part == 0, 2 * part + 1 == parts, part + 1 == parts
            )
