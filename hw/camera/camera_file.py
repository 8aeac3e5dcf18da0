"""The calibration of a camera as a TOML file.

The fields of `hw.api.Calibration`, at the top of a file or below [calibration], as in the run.toml
of a run folder.
"""

from __future__ import annotations

from dataclasses import asdict, fields
from pathlib import Path

import numpy as np
import tomli_w
from pydantic import TypeAdapter, ValidationError

from endolock.hw import files
from endolock.hw.api import Calibration, ConfigError

AGAIN = "make one with endolock calibrate"


def read(path: Path) -> Calibration:
    """Read a calibration.

    Raises:
        ConfigError: the file cannot be read, or is not a calibration.
    """
    data = files.read_toml(path, "calibration", AGAIN)
    values = data.get("calibration", data)
    known = {field.name for field in fields(Calibration)}
    if unknown := set(values) - known:
        raise ConfigError(
            f"calibration {path}: unknown key {min(unknown)}",
            f"use {', '.join(sorted(known))}",
        )
    try:
        found = TypeAdapter(Calibration).validate_python(values)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"calibration {path}: {key}: {first['msg']}", AGAIN) from None
    good = min(found.width, found.height, found.focal_px, found.aspect) > 0
    if not good or not np.isfinite([found.focal_px, *found.centre_px, *found.distortion]).all():
        raise ConfigError(f"calibration {path}: sizes and focal length must be above 0", AGAIN)
    return found


def write(calibration: Calibration, path: Path) -> None:
    """Write a calibration, whole or not at all.

    Raises:
        ConfigError: it cannot be written.
    """
    files.write_whole(path, tomli_w.dumps(asdict(calibration)), "give another file")
