"""The calibration of a camera as a TOML file.

The fields of `hw.api.Calibration`, at the top of a file or below [calibration], as in the run.toml
of a run folder.
"""

from __future__ import annotations

from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from endolock.hw import files
from endolock.hw.api import Calibration, ConfigError
from endolock.hw.camera import plausible_camera
from endolock.hw.camera.plausible_camera import AGAIN
from endolock.hw.strict import shown, strictly

KEYS = tuple(field.name for field in fields(Calibration))


def read(path: Path) -> Calibration:
    """Read a calibration.

    Raises:
        ConfigError: the file cannot be read, or is not a calibration that can be true.
    """
    if path.suffix.lower() in (".yaml", ".yml", ".json", ".xml"):
        raise ConfigError(
            f"calibration {path} is not a TOML file",
            f"{AGAIN}, or write a TOML file with {', '.join(KEYS[:4])} and the other keys of it",
        )
    data = files.read_toml(path, "calibration", AGAIN)
    return checked(data.get("calibration", data), str(path))


def checked(values: Any, source: str) -> Calibration:
    """Make a calibration of the values of a file.

    Args:
        values: what the file says.
        source: what is read, for people.

    Raises:
        ConfigError: they are not a calibration that can be true.
    """
    if not isinstance(values, dict):
        raise ConfigError(f"calibration {source}: calibration is {shown(values)}", AGAIN)
    try:
        found = strictly(Calibration, values)
        plausible_camera.check(found)
    except ValidationError as error:
        what, next_step = files.first_problem(error, lambda _: list(KEYS))
        raise ConfigError(f"calibration {source}: {what}", next_step or AGAIN) from None
    except ConfigError as error:
        raise ConfigError(f"calibration {source}: {error.what}", error.next_step) from None
    return found


def write(calibration: Calibration, path: Path) -> None:
    """Write a calibration, whole or not at all.

    Raises:
        ConfigError: it cannot be written, or cannot be true.
    """
    try:
        plausible_camera.check(calibration)
    except ConfigError as error:
        raise ConfigError(
            f"a camera that cannot be true is not written to {path}: {error.what}",
            "record the board from more directions, in all of the picture",
        ) from None
    files.write_whole(path, tomli_w.dumps(asdict(calibration)), "give another file")
